/** The picture of a step: the old one stays until the new one has loaded. */

import { BoundedMap } from "../elements/bounded-map.js";
import { h, setAttribute } from "../elements/dom.js";
import { requestImage } from "../shell/api.js";
import { LatestRequest } from "../elements/latest-request.js";

// Pictures kept in memory, a few hundred kilobytes each.
const MAX_PICTURES = 14;

export class StepPicture {
  #image = h("img", { alt: "", hidden: true });
  #wait = h("p.step-picture-wait", "Processing the frames…");
  element = h("div.step-picture", this.#image, this.#wait);
  #latest = new LatestRequest();
  #cache = new PictureCache();
  #waiting = new AbortController();

  /** Called when another picture is shown. @type {(url: string, alt: string) => void} */
  shown = () => {};

  /**
   * @param {string} path below /api
   * @param {string} alt
   * @returns {Promise<boolean>} whether it is shown; false if another was requested meanwhile
   * @throws {ApiError}
   */
  async show(path, alt) {
    this.#waiting.abort();
    this.#waiting = new AbortController();
    const { signal } = this.#waiting;
    setAttribute(this.element, "aria-busy", "true");
    try {
      const url = await this.#latest.run(() => this.#cache.get(path, signal));
      if (url === undefined) return false;
      this.#image.src = url;
      this.#image.alt = alt;
      this.#image.hidden = false;
      this.#wait.hidden = true;
      await this.#image.decode().catch(() => {});
      this.shown(url, alt);
      return true;
    } finally {
      if (!signal.aborted) setAttribute(this.element, "aria-busy", null);
    }
  }

  /** Preload a picture that is probably needed next. @param {string} path */
  prepare(path) {
    void this.#cache.get(path, this.#waiting.signal).catch(() => {});
  }
}

class PictureCache {
  /**
   * Object URLs of the pictures by their path.
   *
   * @type {BoundedMap<string, string>}
   */
  #urls = new BoundedMap(MAX_PICTURES, (_, url) => URL.revokeObjectURL(url));

  /** @param {string} path @param {AbortSignal} signal @returns {Promise<string>} */
  async get(path, signal) {
    const kept = this.#urls.get(path);
    if (kept !== undefined) {
      this.#urls.delete(path);
      this.#urls.set(path, kept);
      return kept;
    }
    const { blob } = await requestImage(path, signal);
    const url = URL.createObjectURL(blob);
    // Decode it off the page, so that the previous picture stays meanwhile.
    const image = new Image();
    image.src = url;
    await image.decode().catch(() => {});
    this.#urls.set(path, url);
    return url;
  }
}
