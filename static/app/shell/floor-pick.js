/** One click on the floor of the 3D scene: a part requests it, the scene answers. */

import { Emitter } from "./emitter.js";

/**
 * @typedef {object} FloorPlace m from the robot's current pose
 * @property {number} ahead
 * @property {number} left
 */

/**
 * Events: `change` (whether it is requested, whether it is possible, or the words changed),
 * `picked` (see `place`).
 */
export class FloorPick extends Emitter {
  #possible = false;
  /** Whether a click is being waited for. */
  asked = false;
  /** The newest answer. @type {FloorPlace | null} */
  place = null;
  /** What the scene says about it: what to do, or the outcome. */
  words = "";
  /** Whether the words are a refusal. */
  refused = false;

  /** Whether there is a scene to click in. */
  get possible() {
    return this.#possible;
  }

  set possible(possible) {
    if (possible === this.#possible) return;
    this.#possible = possible;
    if (!possible) this.cancel();
    this.emit("change");
  }

  /** Ask for the next click. @param {string} words what to click at */
  ask(words) {
    if (!this.#possible) return;
    this.asked = true;
    this.say(words);
  }

  /** Cancel the request and clear the words. */
  cancel() {
    if (!this.asked) return;
    this.asked = false;
    this.say("");
  }

  /** Accept the requested click. @param {FloorPlace} place */
  answer(place) {
    if (!this.asked) return;
    this.asked = false;
    this.place = place;
    this.say("");
    this.emit("picked");
  }

  /** @param {string} words empty clears them @param {boolean} [refused] */
  say(words, refused = false) {
    this.words = words;
    this.refused = refused;
    this.emit("change");
  }
}
