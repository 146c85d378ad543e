/** One live view: a canvas that shows the newest image and says when it is stale. */

import { h, paint, setAttribute, setText } from "../elements/dom.js";
import { STALE_AFTER_S } from "../elements/facts.js";
import { GLOSSARY } from "../elements/glossary.js";
import { Part } from "../elements/part.js";
import { STATE_WORDS } from "../elements/words.js";
import { EnlargeButton } from "./enlarge-button.js";
import { PixelQuestion } from "./pixel-question.js";
import { ViewSocket } from "./view-socket.js";

/** @type {Record<string, string>} */
const MEANINGS = { disparity: GLOSSARY["disparity"], residual: GLOSSARY["residual"] };

/** @type {Record<string, {title: string, help: string}>} */
export const VIEWS = {
  left: {
    title: "Left",
    help:
      "Green stars are features, lines their flow. Obstacles: " +
      `red ${STATE_WORDS.moving}, orange ${STATE_WORDS.in_place}, blue ${STATE_WORDS.stopped}, ` +
      `grey ${STATE_WORDS.coasting}; the visible part is shaded. ` +
      "Click any point to ask why it counts as moving or not.",
  },
  warped: {
    title: "Warped",
    help:
      "The newer image warped to the older camera position; black is outside the image. Only the " +
      "affine and homography models warp images.",
  },
  disparity: {
    title: "Disparity",
    help: "Warm colours are near, cold colours far; black means no match between the cameras.",
  },
  residual: {
    title: "Residual",
    help:
      "Motion after subtracting the camera's own motion, drawn at four times its length; red " +
      "counts as moving.",
  },
  camera_left: { title: "Left camera", help: "Unprocessed camera image." },
  camera_right: { title: "Right camera", help: "Unprocessed camera image." },
  plain: { title: "Left, no overlay", help: "The rectified left image without overlays." },
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
  /** Whether it offers to be enlarged. */
  enlarges = false;

  build() {
    this.dataset.view = this.name;
    const { title, help } = VIEWS[this.name] ?? { title: this.name, help: "" };
    const helpId = `view-help-${this.name}`;
    this.#canvas.setAttribute("aria-label", `${title}, live`);
    this.#canvas.setAttribute("aria-describedby", helpId);
    // The other views show another instant or do not depict the scene.
    const question = this.name === "left" ? new PixelQuestion() : null;
    question?.attach(this.hub);
    const enlarge = this.enlarges ? new EnlargeButton() : null;
    if (enlarge) Object.assign(enlarge, { what: this, name: `${title.toLowerCase()} view` });
    enlarge?.attach(this.hub);
    this.append(
      h(
        "figure",
        h("div.view-image", this.#canvas, this.#mark, question?.pick, enlarge),
        h(
          "figcaption",
          h("b", { title: MEANINGS[this.name] ?? null }, title),
          " ",
          h("span", { id: helpId }, help),
        ),
        question,
      ),
    );
    this.#socket = new ViewSocket(this.name, ({ bitmap, ageMs }) => this.#show(bitmap, ageMs));
    this.#visibilityChanged();
    this.listen("visibilitychange", () => this.#visibilityChanged(), document);
    this.listen("page", () => this.#visibilityChanged());
    this.listen("freshness", () => this.#updateFreshness());
    this.#timer = setInterval(() => this.#updateFreshness(), 250);
    this.#updateFreshness();
  }

  disconnectedCallback() {
    super.disconnectedCallback();
    clearInterval(this.#timer);
    this.#socket?.close();
  }

  /** Request images only while visible, so that the server does not draw them for nothing. */
  #visibilityChanged() {
    if (document.hidden || document.body.hasAttribute("data-away")) this.#socket?.close();
    else this.#socket?.open();
  }

  /**
   * @param {ImageBitmap} bitmap
   * @param {number} ageMs
   */
  #show(bitmap, ageMs) {
    this.style.setProperty("--aspect", String(bitmap.width / bitmap.height));
    paint(this.#canvas, bitmap);
    this.#exposed = performance.now() - ageMs;
    this.#updateFreshness();
  }

  #updateFreshness() {
    const age = performance.now() - this.#exposed;
    const { freshness } = this.hub;
    const old = age > 1000 * STALE_AFTER_S;
    const state = !old ? "fresh" : freshness.state === "held" ? "held" : "stale";
    setAttribute(this, "data-freshness", state);
    const seen = Number.isFinite(age);
    setText(this.#mark, seen ? `Stale, ${(age / 1000).toFixed(0)} s old` : "Waiting for an image");
    // If everything is stale, the headline says so; mark here only what this view lacks.
    this.#mark.hidden = state !== "stale" || (seen && freshness.state !== "fresh");
  }
}

customElements.define("observer-live-view", LiveView);
