/** Seeking in a recording: a slider that follows playback until it is moved. */

import { h, input, setAttribute } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { attemptIn } from "../shell/notice.js";

/** @import { PlaybackStatus } from "../contract" */

// The server's status still has the old position for a moment.
const HOLD_MS = 600;

export class ScrubBar extends Part {
  /** Shows why seeking failed. */
  error = h("p.field-error", { role: "alert" });

  #slider = input("range", "scrub", { min: 0, step: 1, "aria-label": "Frame" });
  /** The frame requested but not sent yet. @type {number | null} */
  #wanted = null;
  #busy = false;
  #holdUntil = 0;

  build() {
    this.append(this.#slider);
    this.#slider.addEventListener("input", () => this.#move(this.#slider.valueAsNumber));
    this.listen("status observation", () => this.#render());
    this.#render();
  }

  #render() {
    const { playback, source } = this.hub.status ?? {};
    const count = playback?.seekable ? playback.frame_count : null;
    this.hidden = !count;
    if (!playback || !count) return;
    setAttribute(this.#slider, "max", String(count - 1));
    const held = this.#busy || performance.now() < this.#holdUntil;
    if (!held) this.#slider.value = String(playback.frame ?? 0);
    this.#describe(count, source?.frame_rate ?? 0);
  }

  /**
   * @param {number} count
   * @param {number} rate frames per second
   */
  #describe(count, rate) {
    const frame = this.#slider.valueAsNumber;
    const second = rate > 0 ? `, ${(frame / rate).toFixed(1)} s` : "";
    setAttribute(this.#slider, "aria-valuetext", `frame ${frame} of ${count}${second}`);
    setAttribute(this.#slider, "title", `Frame ${frame} of ${count}${second}`);
  }

  /** @param {number} frame */
  #move(frame) {
    this.#wanted = frame;
    this.#holdUntil = performance.now() + HOLD_MS;
    this.#render();
    void this.#send();
  }

  /** Send one request at a time; of the positions passed meanwhile only the last counts. */
  async #send() {
    if (this.#busy) return;
    this.#busy = true;
    const gone = await attemptIn(this.error, async () => {
      while (this.#wanted !== null) {
        const seek = this.#wanted;
        this.#wanted = null;
        /** @type {PlaybackStatus} */
        const playback = await request("POST", "/playback", { seek });
        this.#holdUntil = performance.now() + HOLD_MS;
        if (this.hub.status) this.hub.applyStatus({ ...this.hub.status, playback });
      }
    }).finally(() => (this.#busy = false));
    if (!gone) {
      this.#wanted = null;
      this.#holdUntil = 0;
    }
    this.#render();
  }
}

customElements.define("observer-scrub", ScrubBar);
