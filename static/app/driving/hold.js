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
const DEAD_ZONE = 0.12;

/** Return the deflection beyond the dead zone around the middle. @param {number} axis */
export function applyDeadZone(axis) {
  const size = Math.min(1, Math.abs(axis));
  return size < DEAD_ZONE ? 0 : (Math.sign(axis) * (size - DEAD_ZONE)) / (1 - DEAD_ZONE);
}

/**
 * Combines all controls that can be held to move a robot.
 *
 * Events: `pressed` (nothing was held before), `released` (nothing is held any more, or the hold
 * was blocked), `cleared` (a control must be seen released before it can be pressed again),
 * `change`.
 */
export class Hold extends Emitter {
  /** @type {Map<Holder, Deflection>} */
  #held = new Map();
  /** Why the hold is blocked until every control is released; empty while it counts. */
  blockedReason = "";

  /** True while something is held and counts. */
  get isActive() {
    return this.#held.size > 0 && !this.blockedReason;
  }

  get isHeld() {
    return this.#held.size > 0;
  }

  /** Deflection of the newest holder; null if nothing is held or the hold is blocked. */
  get deflection() {
    return this.isActive ? ([...this.#held.values()].at(-1) ?? null) : null;
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
    const wasActive = this.isActive;
    if (!this.#held.delete(holder)) return;
    if (this.#held.size === 0) this.blockedReason = "";
    if (wasActive && !this.isActive) this.emit("released");
    this.emit("change");
  }

  /** Drop all holds, as no release may come: focus lost, page hidden, robots stopped. */
  releaseAll() {
    const wasActive = this.isActive;
    this.#held.clear();
    this.blockedReason = "";
    this.emit("cleared");
    if (wasActive) this.emit("released");
    this.emit("change");
  }

  /**
   * Ignore what is held until every control has been released.
   *
   * @param {string} why one sentence
   */
  block(why) {
    if (!this.isActive) return;
    this.blockedReason = why;
    this.emit("released");
    this.emit("change");
  }
}
