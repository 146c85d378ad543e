/** The controls that the user holds: pad, keys, gamepad. No timer, no socket here. */

import { Emitter } from "../shell/emitter.js";

/**
 * Deflection of a control, each axis from -1 to 1.
 *
 * @typedef {object} Deflection
 * @property {number} forward
 * @property {number} left
 *
 * @typedef {"pad" | "keys" | "gamepad"} Holder
 */

// Dead zone as a share of full deflection: within it a control is held but moves nothing.
const STILL = 0.12;

/** Return the deflection beyond the dead zone around the middle. @param {number} axis */
export function beyondStill(axis) {
  const size = Math.min(1, Math.abs(axis));
  return size < STILL ? 0 : (Math.sign(axis) * (size - STILL)) / (1 - STILL);
}

/**
 * Combines all controls that can be held to move a robot.
 *
 * Events: `pressed` (nothing was held before), `released` (nothing is held any more, or the hold
 * was barred), `forgotten` (a control must be seen released before it can be pressed again),
 * `change`.
 */
export class Hold extends Emitter {
  /** @type {Map<Holder, Deflection>} */
  #held = new Map();
  /** Why the hold is barred until every control is released; empty while it counts. */
  barred = "";

  /** True while something is held and counts. */
  get counts() {
    return this.#held.size > 0 && !this.barred;
  }

  get isHeld() {
    return this.#held.size > 0;
  }

  /** Deflection of the newest holder; null if nothing is held or the hold is barred. */
  get deflection() {
    return this.counts ? ([...this.#held.values()].at(-1) ?? null) : null;
  }

  /**
   * Record that a control is pressed or moved.
   *
   * @param {Holder} holder
   * @param {Deflection} deflection
   */
  set(holder, deflection) {
    const first = this.#held.size === 0;
    this.#held.set(holder, deflection);
    if (first) this.emit("pressed");
    this.emit("change");
  }

  /** @param {Holder} holder */
  release(holder) {
    const counted = this.counts;
    if (!this.#held.delete(holder)) return;
    if (this.#held.size === 0) this.barred = "";
    if (counted && !this.counts) this.emit("released");
    this.emit("change");
  }

  /** Drop all holds, as no release may come: focus lost, page hidden, robots stopped. */
  forget() {
    const counted = this.counts;
    this.#held.clear();
    this.barred = "";
    this.emit("forgotten");
    if (counted) this.emit("released");
    this.emit("change");
  }

  /**
   * Ignore what is held until every control has been released.
   *
   * @param {string} why one sentence
   */
  bar(why) {
    if (!this.counts) return;
    this.barred = why;
    this.emit("released");
    this.emit("change");
  }
}
