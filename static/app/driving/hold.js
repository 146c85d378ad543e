/** The controls that a person holds: pad, keys, gamepad. No timer, no socket here. */

import { Teller } from "../shell/teller.js";

/**
 * Deflection of a control, each axis from -1 to 1.
 *
 * @typedef {object} Deflection
 * @property {number} forward
 * @property {number} left
 *
 * @typedef {"pad" | "keys" | "gamepad"} Holder
 */

// Of the way from the middle: nearer to it something is held, but moves nothing.
const STILL = 0.12;

/** Return the deflection beyond the dead zone around the middle. @param {number} axis */
export function beyondStill(axis) {
  const size = Math.min(1, Math.abs(axis));
  return size < STILL ? 0 : (Math.sign(axis) * (size - STILL)) / (1 - STILL);
}

/**
 * Joins everything by which a robot is held moving.
 *
 * Events: `pressed` (nothing was held before), `released` (nothing is held any more, or what is
 * held counts no longer), `forgotten` (whoever watches a holder must see it released before it is
 * pressed again), `change`.
 */
export class Hold extends Teller {
  /** @type {Map<Holder, Deflection>} */
  #held = new Map();
  /** The reason why the hold is barred until all of it is let go; empty while it counts. */
  barred = "";

  /** True while something is held and counts. */
  get counts() {
    return this.#held.size > 0 && !this.barred;
  }

  get isHeld() {
    return this.#held.size > 0;
  }

  /** Deflection of the newest holder; null where nothing is held or the hold is barred. */
  get deflection() {
    return this.counts ? ([...this.#held.values()].at(-1) ?? null) : null;
  }

  /**
   * Something is pressed, or what is pressed is moved.
   *
   * @param {Holder} holder
   * @param {Deflection} deflection
   */
  set(holder, deflection) {
    const first = this.#held.size === 0;
    this.#held.set(holder, deflection);
    if (first) this.tell("pressed");
    this.tell("change");
  }

  /** @param {Holder} holder */
  release(holder) {
    const counted = this.counts;
    if (!this.#held.delete(holder)) return;
    if (this.#held.size === 0) this.barred = "";
    if (counted && !this.counts) this.tell("released");
    this.tell("change");
  }

  /** Nobody is there to let go: the window lost its focus, the page was hidden, a robot stopped. */
  forget() {
    const counted = this.counts;
    this.#held.clear();
    this.barred = "";
    this.tell("forgotten");
    if (counted) this.tell("released");
    this.tell("change");
  }

  /**
   * What is held counts for nothing until all of it was let go.
   *
   * @param {string} why one sentence
   */
  bar(why) {
    if (!this.counts) return;
    this.barred = why;
    this.tell("released");
    this.tell("change");
  }
}
