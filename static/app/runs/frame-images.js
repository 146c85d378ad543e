/** The images of a run's frames, prefetched ahead of the frame shown. */

import { BoundedMap } from "../elements/bounded-map.js";
import { Aborted, ApiError, requestImage } from "../shell/api.js";

const MAX_CONCURRENT = 3;
// About 20 MB for a 640x480 camera.
const MAX_IMAGES = 300;

export class FrameImages {
  /** Why there are no images; empty if there are. */
  trouble = "";

  #path;
  #count;
  #stop = new AbortController();
  /** @type {BoundedMap<number, Promise<Blob | null>>} */
  #cache = new BoundedMap(MAX_IMAGES);
  #going = 0;
  #next = 0;

  /**
   * @param {string} id of the run
   * @param {number} count of its frames
   */
  constructor(id, count) {
    this.#path = `/runs/${encodeURIComponent(id)}/frames`;
    this.#count = count;
  }

  /**
   * @param {number} position
   * @returns {Promise<ImageBitmap | null>} null if there is none; the caller closes it
   */
  async at(position) {
    this.#next = position + 1;
    const blob = await this.#get(position);
    this.#fetchAhead();
    // Treat a damaged image as missing.
    return blob && createImageBitmap(blob).catch(() => null);
  }

  /** Stop fetching. */
  close() {
    this.#stop.abort();
    this.#cache.clear();
  }

  /** @param {number} position */
  #get(position) {
    let image = this.#cache.get(position);
    if (!image) {
      image = this.#fetch(position);
      this.#cache.set(position, image);
    }
    return image;
  }

  /** @param {number} position */
  async #fetch(position) {
    this.#going += 1;
    try {
      const { blob } = await requestImage(`${this.#path}/${position}.jpg`, this.#stop.signal);
      this.trouble = "";
      return blob;
    } catch (error) {
      if (error instanceof ApiError) this.trouble = error.message;
      else if (!(error instanceof Aborted)) throw error;
      // Try again next time.
      this.#cache.delete(position);
      return null;
    } finally {
      this.#going -= 1;
      if (!this.trouble) this.#fetchAhead();
    }
  }

  #fetchAhead() {
    const end = Math.min(this.#count, this.#next + MAX_IMAGES / 2);
    while (this.#going < MAX_CONCURRENT && !this.#stop.signal.aborted) {
      while (this.#next < end && this.#cache.has(this.#next)) this.#next += 1;
      if (this.#next >= end) return;
      void this.#get(this.#next);
    }
  }
}
