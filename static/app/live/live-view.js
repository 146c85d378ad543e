/** One live view: a canvas that shows the newest image, and says when it is old. */

import { h, paint, setAttribute, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { PixelQuestion } from "./pixel-question.js";
import { ViewSocket } from "./view-socket.js";

const STALE_AFTER_MS = 1000;

/** @type {Record<string, {title: string, help: string}>} */
export const VIEWS = {
  left: {
    title: "Left",
    help:
      "Green stars are features, lines their flow. A yellow box is an obstacle that moves, a blue " +
      "one stands for now, a grey one is out of sight; shaded is all that is seen of it. " +
      "Click a place to ask why it counts as moving or not.",
  },
  warped: {
    title: "Warped",
    help:
      "The newer image moved back to where the older one was taken; black is outside it. Only " +
      "affine and homography transform images.",
  },
  disparity: {
    title: "Disparity",
    help: "Warm colours are near, cold ones far; black is where the two cameras find no match.",
  },
  residual: {
    title: "Residual",
    help:
      "Motion that is left after the camera's own is taken away, drawn four times as long; red " +
      "counts as dynamic.",
  },
  camera_left: { title: "Left camera", help: "As taken." },
  camera_right: { title: "Right camera", help: "As taken." },
  plain: { title: "Plain left", help: "The rectified left image with nothing drawn on it." },
};

export class LiveView extends Part {
  #canvas = h("canvas", { width: 512, height: 256, role: "img" });
  #mark = h("span.stale-mark", "Waiting for an image");
  /** @type {ViewSocket | null} */
  #socket = null;
  #exposed = -Infinity;
  #timer = 0;

  /** @type {string} */
  name = "left";

  build() {
    this.dataset.view = this.name;
    const { title, help } = VIEWS[this.name] ?? { title: this.name, help: "" };
    const helpId = `view-help-${this.name}`;
    this.#canvas.setAttribute("aria-label", `${title}, live`);
    this.#canvas.setAttribute("aria-describedby", helpId);
    // The other views show another instant, or are no picture of a place.
    const question = this.name === "left" ? new PixelQuestion() : null;
    question?.attach(this.hub);
    this.append(
      h(
        "figure",
        h("div.view-image", this.#canvas, this.#mark, question?.pick),
        h("figcaption", h("b", title), " ", h("span", { id: helpId }, help)),
        question,
      ),
    );
    this.#socket = new ViewSocket(this.name, ({ bitmap, ageMs }) => this.#show(bitmap, ageMs));
    this.#visibilityChanged();
    this.hear("visibilitychange", () => this.#visibilityChanged(), document);
    this.hear("history", () => this.#visibilityChanged());
    this.hear("freshness", () => this.#judge());
    this.#timer = setInterval(() => this.#judge(), 250);
    this.#judge();
  }

  disconnectedCallback() {
    super.disconnectedCallback();
    clearInterval(this.#timer);
    this.#socket?.close();
  }

  /** Ask for no images where nobody looks, so that the server draws none. */
  #visibilityChanged() {
    if (document.hidden || document.body.hasAttribute("data-history")) this.#socket?.close();
    else this.#socket?.open();
  }

  /**
   * @param {ImageBitmap} bitmap
   * @param {number} ageMs
   */
  #show(bitmap, ageMs) {
    paint(this.#canvas, bitmap);
    this.#exposed = performance.now() - ageMs;
    this.#judge();
  }

  #judge() {
    const age = performance.now() - this.#exposed;
    const { freshness } = this.hub;
    const old = age > STALE_AFTER_MS;
    const state = !old ? "fresh" : freshness.state === "held" ? "held" : "stale";
    setAttribute(this, "data-freshness", state);
    const seconds = `${(age / 1000).toFixed(0)} s old`;
    const text = Number.isFinite(age) ? seconds : "Waiting for an image";
    setText(this.#mark, state === "stale" && Number.isFinite(age) ? `Stale, ${text}` : text);
    this.#mark.hidden = state === "fresh";
  }
}

customElements.define("observer-live-view", LiveView);
