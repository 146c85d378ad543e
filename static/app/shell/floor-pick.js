/** One click on the floor of the 3D scene: a part asks for it, the scene answers. */

import { Teller } from "./teller.js";

/**
 * @typedef {object} FloorPlace m from the robot as it stands
 * @property {number} ahead
 * @property {number} left
 */

/**
 * Events: `change` (it is asked for or no more, is possible or not, or something else is said of
 * it), `picked` (see `place`).
 */
export class FloorPick extends Teller {
  #possible = false;
  /** Whether a click is waited for. */
  asked = false;
  /** The newest answer. @type {FloorPlace | null} */
  place = null;
  /** What the scene says of it: what to do, what became of it. */
  words = "";
  /** Whether that is a refusal. */
  refused = false;

  /** Whether there is a scene to click in. */
  get possible() {
    return this.#possible;
  }

  set possible(possible) {
    if (possible === this.#possible) return;
    this.#possible = possible;
    if (!possible) this.cancel();
    this.tell("change");
  }

  /** Ask for the next click. @param {string} words what to click at */
  ask(words) {
    if (!this.#possible) return;
    this.asked = true;
    this.say(words);
  }

  /** Ask no more; what was said of it goes. */
  cancel() {
    if (!this.asked) return;
    this.asked = false;
    this.say("");
  }

  /** Take the click that was asked for. @param {FloorPlace} place */
  answer(place) {
    if (!this.asked) return;
    this.asked = false;
    this.place = place;
    this.say("");
    this.tell("picked");
  }

  /** @param {string} words empty takes them away @param {boolean} [refused] */
  say(words, refused = false) {
    this.words = words;
    this.refused = refused;
    this.tell("change");
  }
}
