/**
 * What was found in the frames of a run: entries spread over the whole run at first, the others on
 * demand. A short run's entries are all loaded at once.
 */

import { BoundedMap } from "../elements/bounded-map.js";
import { request } from "../shell/api.js";
import { frameAt } from "./run-words.js";

/** @import { FrameEntry, PlanMap, RunFrames } from "../contract" */

// More than a top view or a slider can resolve; about a minute of a camera.
const SPREAD = 1000;
const PAGE = 200;
// Enough for playback, the neighbouring pages and some jumping about.
const MAX_PAGES = 12;

export class FrameEntries {
  #path;
  /** @type {RunFrames} */
  #spread;
  /** @type {Map<number, RunFrames>} */
  #pages = new Map();
  /** By number. @type {BoundedMap<number, Promise<RunFrames | null>>} */
  #asked = new BoundedMap(MAX_PAGES, (number) => this.#pages.delete(number));

  /**
   * Load the entries spread over a run.
   *
   * @param {string} id of the run
   * @returns {Promise<FrameEntries>}
   */
  static async of(id) {
    const path = `/runs/${encodeURIComponent(id)}/frames`;
    return new FrameEntries(path, await request("GET", `${path}?most=${SPREAD}`));
  }

  /** @param {string} path of the frames @param {RunFrames} spread */
  constructor(path, spread) {
    this.#path = path;
    this.#spread = spread;
  }

  get count() {
    return this.#spread.count;
  }

  /** Size of the image that the boxes refer to. @returns {{width: number, height: number}} */
  get size() {
    return this.#spread;
  }

  /** Whether the observer had a goal in any entry spread over the run. */
  get hasGoal() {
    return this.#spread.frames.some(({ goal }) => goal !== null);
  }

  /** The entries spread over the run, in order. */
  get spread() {
    return this.#spread.frames;
  }

  /** Return the entry of a frame; null until `fetch` has loaded it. @param {number} position */
  at(position) {
    const { every, frames } = this.#spread;
    if (position % every === 0) return frames[position / every] ?? null;
    const page = this.#pages.get(Math.floor(position / PAGE));
    return page?.frames[position % PAGE] ?? null;
  }

  /** Return the nearest loaded entry. @param {number} position @returns {FrameEntry | null} */
  near(position) {
    const { every, frames } = this.#spread;
    const nearest = Math.min(Math.round(position / every), frames.length - 1);
    return this.at(position) ?? frames[nearest] ?? null;
  }

  /**
   * Return the local map valid at a frame; null if there is none or it is not loaded yet.
   *
   * @param {number} position
   * @returns {PlanMap | null}
   */
  mapAt(position) {
    const page = this.#pages.get(Math.floor(position / PAGE));
    const { maps } = this.#spread.every === 1 ? this.#spread : (page ?? { maps: [] });
    return maps.find(({ first, last }) => first <= position && position <= last) ?? null;
  }

  /**
   * Load the entry of a frame together with those around it and soon after.
   *
   * @param {number} position
   * @returns {Promise<FrameEntry | null>} null if it cannot be read
   */
  async fetch(position) {
    const number = Math.floor(position / PAGE);
    if (this.#spread.every > 1 && position % PAGE > PAGE / 2 && (number + 1) * PAGE < this.count)
      void this.#page(number + 1);
    if (!this.at(position)) await this.#page(number);
    return this.at(position);
  }

  /** Return a frame's time, s on the run's clock. @param {number} position */
  timeAt(position) {
    const exact = this.at(position);
    if (exact) return exact.plan.time;
    const { every, frames } = this.#spread;
    const before = Math.min(Math.floor(position / every), frames.length - 1);
    const [a, b] = [frames[before], frames[before + 1] ?? frames[before]];
    const from = a?.plan.time ?? 0;
    return from + (((b?.plan.time ?? 0) - from) * (position - before * every)) / every;
  }

  /** Return the frame nearest to a time, s on the run's clock. @param {number} time */
  positionAt(time) {
    const { every, frames } = this.#spread;
    const near = frameAt(frames, time) * every;
    let [low, high] = [Math.max(0, near - every), Math.min(this.count - 1, near + every)];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time > (this.timeAt(middle) + this.timeAt(middle + 1)) / 2) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** @param {number} number */
  #page(number) {
    let asked = this.#asked.get(number);
    if (!asked) {
      asked = this.#read(number);
      this.#asked.set(number, asked);
    }
    return asked;
  }

  /** @param {number} number @returns {Promise<RunFrames | null>} */
  async #read(number) {
    /** @type {RunFrames | null} */
    const page = await request("GET", `${this.#path}?first=${number * PAGE}&count=${PAGE}`).catch(
      () => null,
    );
    if (page) this.#pages.set(number, page);
    // Try again next time.
    else this.#asked.delete(number);
    return page;
  }
}
