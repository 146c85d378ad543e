/** When each obstacle was last measured: while it is out of view, all that is sent is predicted. */

/** @import { LiveLine, ObstacleEntry } from "../contract" */

/** @typedef {Pick<ObstacleEntry, "speed" | "speed_std"> & {ago_s: number}} Sighting the last measured */

export class LastSeen {
  /** @type {Map<number, {time: number, speed: number, speed_std: number | null}>} */
  #seen = new Map();
  #segment = -1;
  #time = -Infinity;

  /** @param {LiveLine} line the newest; a new segment or an earlier time begins anew */
  take({ segment, time, obstacles }) {
    if (segment !== this.#segment || time < this.#time) this.#seen.clear();
    this.#segment = segment;
    this.#time = time;
    const present = new Set(obstacles.map(({ id }) => id));
    for (const id of this.#seen.keys()) if (!present.has(id)) this.#seen.delete(id);
    for (const { id, state, speed, speed_std } of obstacles)
      if (state !== "coasting") this.#seen.set(id, { time, speed, speed_std });
  }

  /** @param {number} id @returns {Sighting | null} null if it was never seen here */
  of(id) {
    const seen = this.#seen.get(id);
    if (!seen) return null;
    const { time, speed, speed_std } = seen;
    return { speed, speed_std, ago_s: this.#time - time };
  }
}
