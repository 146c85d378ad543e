/** Lets the user ask why a pixel of a view counts as moving, static or neither. */

import { button, h, icon, setAttribute, setText } from "../elements/dom.js";
import { figuresOf, fillFigures } from "../elements/figure-list.js";
import { declareKeys, isCovered } from "../elements/keys.js";
import { Part } from "../elements/part.js";
import { storeOf } from "../parameters/parameter-store.js";
import { withTitles } from "../parameters/value-words.js";
import { request } from "../shell/api.js";

/** @import { Pixel } from "../contract" */

declareKeys(
  "Asking about a pixel",
  ["↑ ← ↓ →", "Move the mark"],
  ["Shift+arrow", "Move it by one pixel"],
  ["Enter", "Ask"],
  ["Esc", "Close the answer"],
);

/** @type {Record<string, string>} */
const VERDICTS = {
  dynamic: "Moving",
  static: "Static",
  undecided: "Undecided",
  too_far: "Too far",
  too_few_features: "Too few features",
  ego_motion_lost: "Camera motion lost",
};

const ARROWS = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};
// An arrow key moves the mark by this many pixels, with Shift by one.
const STEP_PX = 8;

export class PixelQuestion extends Part {
  /** Covers the image; a click asks about that place, Enter about the marked one. */
  pick = button([], null, {
    class: "pixel-pick",
    "aria-label": "Ask about a pixel in the left image: arrow keys move the mark, Enter asks",
  });
  #mark = h("span.pixel-mark", { hidden: true });
  #verdict = h("b.verdict-chip");
  #where = h("span.hint.figure");
  #sentence = h("p");
  #obstacle = h("p.hint");
  #figures = h("dl.figures");
  #change = h("p.change");
  #card = h("section.answer", { "aria-label": "Answer", hidden: true });
  #words = h("div.stack", { "aria-live": "polite" });
  /** @type {[number, number] | null} */
  #px = null;
  /** @type {string | null} */
  #source = null;
  #asked = 0;
  #onKey = (/** @type {KeyboardEvent} */ event) => this.#closeByKey(event);

  build() {
    this.pick.append(this.#mark);
    this.pick.addEventListener("click", (event) => this.#clicked(event));
    this.pick.addEventListener("keydown", (event) => this.#moved(event));
    const again = button("Ask again", () => this.#ask());
    const close = button(icon("close"), () => this.#close(), {
      class: "quiet",
      "aria-label": "Close answer",
    });
    this.#words.append(this.#sentence, this.#obstacle, this.#change);
    this.#card.append(
      h("div.answer-head", this.#verdict, this.#where, close),
      this.#words,
      this.#figures,
      h("div.row.end", again),
    );
    this.append(this.#card);
    this.listen("status", () => this.#sourceChanged());
    document.addEventListener("keydown", this.#onKey);
  }

  disconnectedCallback() {
    super.disconnectedCallback();
    document.removeEventListener("keydown", this.#onKey);
  }

  /** @returns {[number, number]} width and height of the image */
  get #size() {
    const { camera } = this.hub.status ?? {};
    return camera ? [camera.width, camera.height] : [512, 256];
  }

  /** @param {MouseEvent} event */
  #clicked(event) {
    const [width, height] = this.#size;
    // A click triggered by a key has no position.
    if (event.detail > 0) {
      const box = this.pick.getBoundingClientRect();
      this.#place(
        ((event.clientX - box.left) / box.width) * width - 0.5,
        ((event.clientY - box.top) / box.height) * height - 0.5,
      );
    } else if (!this.#px) {
      this.#place(width / 2, height / 2);
    }
    void this.#ask();
  }

  /** @param {KeyboardEvent} event */
  #moved(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = ARROWS[/** @type {keyof typeof ARROWS} */ (event.key)];
    if (!arrow) return;
    event.preventDefault();
    const [width, height] = this.#size;
    const [u, v] = this.#px ?? [width / 2, height / 2];
    const step = event.shiftKey ? 1 : STEP_PX;
    const [right = 0, down = 0] = arrow;
    this.#place(u + right * step, v + down * step);
  }

  /**
   * Put the mark on the nearest pixel of the image.
   *
   * @param {number} u
   * @param {number} v
   */
  #place(u, v) {
    const [width, height] = this.#size;
    const clamped = (/** @type {number} */ x, /** @type {number} */ size) =>
      Math.min(size - 1, Math.max(0, Math.round(x)));
    this.#px = [clamped(u, width), clamped(v, height)];
    this.#mark.style.left = `${(100 * (this.#px[0] + 0.5)) / width}%`;
    this.#mark.style.top = `${(100 * (this.#px[1] + 0.5)) / height}%`;
    this.#mark.hidden = false;
    setAttribute(this.#mark, "data-verdict", null);
  }

  async #ask() {
    if (!this.#px) return;
    const [u, v] = this.#px;
    const asked = ++this.#asked;
    try {
      /** @type {Pixel} */
      const answer = await request("GET", `/pixel?u=${u}&v=${v}`);
      if (asked === this.#asked) this.#show(answer);
    } catch (error) {
      if (asked === this.#asked)
        this.#refuse(error instanceof Error ? error.message : String(error));
    }
  }

  /** @param {Pixel} answer */
  #show(answer) {
    const { verdict, obstacle } = answer;
    setText(this.#verdict, VERDICTS[verdict] ?? verdict);
    setAttribute(this.#verdict, "data-verdict", verdict);
    setAttribute(this.#mark, "data-verdict", verdict);
    setText(this.#where, `Pixel ${answer.u}, ${answer.v} · frame ${answer.frame}`);
    setText(this.#sentence, answer.sentence);
    this.#obstacle.hidden = obstacle === null;
    if (obstacle) {
      const state = obstacle.reported ? "" : ", not confirmed yet";
      const name = obstacle.id < 0 ? "An obstacle" : `Obstacle ${obstacle.id}`;
      setText(this.#obstacle, `${name}${state}: ${obstacle.why.replace(/\.?$/, ".")}`);
    }
    const change = withTitles(answer.would_change, storeOf(this.hub).schema);
    this.#change.replaceChildren(h("b", "What would change it: "), change);
    this.#change.hidden = false;
    fillFigures(this.#figures, figuresOf(answer.numbers));
    this.#open();
  }

  /** @param {string} sentence */
  #refuse(sentence) {
    setText(this.#verdict, "No answer");
    setAttribute(this.#verdict, "data-verdict", null);
    setText(this.#where, this.#px ? `Pixel ${this.#px.join(", ")}` : "");
    setText(this.#sentence, sentence);
    this.#obstacle.hidden = this.#change.hidden = true;
    fillFigures(this.#figures, []);
    this.#open();
  }

  #open() {
    this.#source = this.hub.status?.source?.spec ?? null;
    this.#card.hidden = false;
    // Scroll the words into view while keeping as much of the image visible as possible.
    this.#words.scrollIntoView({ block: "nearest" });
  }

  #close() {
    const focused = this.#card.contains(document.activeElement);
    this.#asked++;
    this.#card.hidden = true;
    this.#mark.hidden = true;
    if (focused) this.pick.focus();
  }

  /** @param {KeyboardEvent} event */
  #closeByKey(event) {
    if (event.key !== "Escape" || event.defaultPrevented || isCovered()) return;
    if (this.#mark.hidden) return;
    event.preventDefault();
    this.#close();
  }

  /** Close the answer if another source has been opened, which it does not concern. */
  #sourceChanged() {
    const spec = this.hub.status?.source?.spec ?? null;
    if (!this.#card.hidden && spec !== this.#source) {
      this.#px = null;
      this.#close();
    }
  }
}

customElements.define("observer-pixel-question", PixelQuestion);
