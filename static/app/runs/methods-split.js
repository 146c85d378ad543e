/** Two methods side by side on the same frames, one slider for both. */

import { h, iconButton, input, offerPlayback, setAttribute, setText } from "../elements/dom.js";
import { OBSTACLE_COLOURS } from "../elements/facts.js";
import { fillFigures } from "../elements/figure-list.js";
import { declareKeys, playOnSpace } from "../elements/keys.js";
import { Part } from "../elements/part.js";
import { fixed, STATE_WORDS } from "../elements/words.js";
import { FrameImages } from "./frame-images.js";
import { OverlaidPicture } from "./methods-overlay.js";
import { conclusion, figuresAt, methodsHref, findingsInWords } from "./methods-words.js";

/** @import { Method } from "./methods-words.js" */

declareKeys(
  "Comparison of methods",
  ["Space", "Play or pause, anywhere on its page, unless a robot is armed"],
  ["← →", "Previous or next frame"],
  ["Page↑ Page↓", "10 frames back or forward"],
  ["Home End", "First or last frame"],
);

// The address follows the frame shown, but browsers limit how often it may change.
const ADDRESS_AFTER_MS = 400;
/** @type {[string, string][]} */
const LEGEND = [
  ["moving", "moving obstacle; arrow: motion in 1 s"],
  ["false", "false obstacle"],
  ["in_place", STATE_WORDS.in_place],
  ["stopped", STATE_WORDS.stopped],
  ["coasting", STATE_WORDS.coasting],
  ["truth", "ground truth"],
];

class Pane {
  #name = h("h3");
  #figures = h("dl.figures");
  picture = new OverlaidPicture();
  element = h(
    "section.methods-pane",
    h("header.pane-head", this.#name),
    this.picture.element,
    this.#figures,
  );

  /** @param {Method} method */
  begin({ name, found }) {
    setText(this.#name, name);
    setAttribute(this.element, "aria-label", name);
    this.picture.resize(found.width, found.height);
  }

  /** @param {Method} method @param {number} position */
  count({ found }, position) {
    fillFigures(this.#figures, figuresAt(found, position));
    this.#figures.firstElementChild?.setAttribute("data-first", "");
  }
}

/** @param {string} kind */
function key(kind) {
  const mark = h("span.methods-key", { "data-kind": kind });
  mark.style.color = /** @type {Record<string, string>} */ (OBSTACLE_COLOURS)[kind] ?? "";
  return mark;
}

export class MethodsSplit extends Part {
  #conclusion = h("p.methods-conclusion");
  #panes = [new Pane(), new Pane()];
  #play = iconButton("play", "Play", () => this.#toggle());
  #slider = input("range", "methods-frame", { min: 0, step: 1, "aria-label": "Frame" });
  #place = h("span.figure.methods-position");
  #truth = input("checkbox", "methods-truth", { checked: true });
  #truthLabel = h("label.check", this.#truth, "Ground truth");
  #legend = h("ul.legend", { "aria-label": "Legend" });
  #trouble = h("p.hint", { role: "status" });
  #stage = h("div.methods-stage", {
    tabindex: "0",
    role: "group",
    "aria-label": "Both methods on the same frame; arrow keys go to other frames, Space plays",
  });
  /** @type {Method[]} */
  #methods = [];
  /** @type {FrameImages | null} */
  #images = null;
  #position = 0;
  #shown = 0;
  /** While playing: when the first frame was due, ms. @type {number | null} */
  #began = null;
  /** Number of starts and pauses: it ends the playback begun before the newest. */
  #turns = 0;
  #timer = 0;

  build() {
    this.#stage.append(h("div.methods-panes", ...this.#panes.map(({ element }) => element)));
    this.append(
      this.#conclusion,
      this.#stage,
      h("div.methods-controls", this.#play, this.#slider, this.#place),
      h("div.row.methods-legend", this.#legend, this.#truthLabel),
      this.#trouble,
    );
    this.#slider.addEventListener("input", () => this.#seek(this.#slider.valueAsNumber));
    this.#truth.addEventListener("change", () => void this.#show());
    this.#stage.addEventListener("keydown", (event) => this.#key(event));
    playOnSpace(
      this,
      () => !this.hidden && this.checkVisibility(),
      () => this.#toggle(),
    );
    // Redraw, so that text and lines keep their size on the screen.
    const sizes = new ResizeObserver(() => void this.#show());
    sizes.observe(this.#stage);
  }

  /**
   * @param {Method[]} methods two, of the same frames, or none
   * @param {number | null} position of the first frame to show; null: play from the first one
   */
  show(methods, position = null) {
    this.#pause();
    this.#images?.close();
    this.#images = null;
    this.#methods = methods;
    const [first] = methods;
    this.hidden = !first;
    if (!first) return;
    this.#images = new FrameImages(first.run.id, this.#count);
    setText(this.#conclusion, conclusion(methods));
    methods.forEach((method, at) => this.#panes[at]?.begin(method));
    setAttribute(this.#slider, "max", String(Math.max(0, this.#count - 1)));
    const known = first.found.truth;
    this.#truthLabel.hidden = !known;
    this.#legend.replaceChildren(
      ...LEGEND.filter(([kind]) => known || !["false", "truth"].includes(kind)).map(
        ([kind, words]) => h("li", key(kind), words),
      ),
    );
    this.#position = this.#within(position ?? 0);
    void this.#show();
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (position === null && !still) this.#start();
  }

  /** Go to a frame and stay there. @param {number} position */
  goTo(position) {
    if (this.#methods.length > 0 && position !== this.#position) this.#seek(position);
  }

  get #count() {
    return this.#methods[0]?.found.frames.length ?? 0;
  }

  /** @param {number} position */
  #within(position) {
    return Math.min(Math.max(position, 0), Math.max(0, this.#count - 1));
  }

  /** @param {number} position */
  #time(position) {
    return this.#methods[0]?.found.frames[position]?.time ?? 0;
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const last = this.#count - 1;
    /** @type {Record<string, () => void>} */
    const does = {
      ArrowLeft: () => this.#seek(this.#position - 1),
      ArrowRight: () => this.#seek(this.#position + 1),
      PageUp: () => this.#seek(this.#position - 10),
      PageDown: () => this.#seek(this.#position + 10),
      Home: () => this.#seek(0),
      End: () => this.#seek(last),
    };
    const act = does[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  #toggle() {
    if (this.#began !== null) this.#pause();
    else this.#start();
  }

  #start() {
    if (this.#count < 2) return;
    if (this.#position >= this.#count - 1) this.#position = 0;
    this.#began = performance.now() - 1000 * (this.#time(this.#position) - this.#time(0));
    this.#turns += 1;
    offerPlayback(this.#play, true);
    void this.#playNext(this.#turns);
  }

  #pause() {
    clearTimeout(this.#timer);
    if (this.#began === null) return;
    this.#began = null;
    this.#turns += 1;
    offerPlayback(this.#play, false);
    this.#updateAddress();
  }

  /**
   * Show the frame that is due and continue; late frames are not skipped but delay the rest.
   *
   * @param {number} turn of the start
   */
  async #playNext(turn) {
    await this.#show();
    if (turn !== this.#turns || this.#began === null || !this.isConnected) return;
    if (this.#position >= this.#count - 1) return this.#pause();
    const due = () => (this.#began ?? 0) + 1000 * (this.#time(this.#position + 1) - this.#time(0));
    const wait = due() - performance.now();
    if (wait < 0) this.#began -= wait;
    this.#timer = setTimeout(
      () => {
        this.#position = this.#within(this.#position + 1);
        void this.#playNext(turn);
      },
      Math.max(0, wait),
    );
  }

  /** @param {number} position */
  #seek(position) {
    this.#pause();
    this.#position = this.#within(position);
    void this.#show();
    this.#updateAddress();
  }

  #updateAddress() {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      const ids = this.#methods.map(({ run }) => run.id);
      if (ids.length > 0 && !this.hidden && location.hash.startsWith(methodsHref(ids)))
        history.replaceState(history.state, "", methodsHref(ids, this.#position));
    }, ADDRESS_AFTER_MS);
  }

  /** Show the frame at the current position; of several requests at once only the last counts. */
  async #show() {
    const images = this.#images;
    const position = this.#position;
    if (!images || this.hidden) return;
    const shown = ++this.#shown;
    this.#slider.value = String(position);
    const image = await images.at(position);
    if (shown === this.#shown) {
      const time = this.#time(position) - this.#time(0);
      const words = `frame ${position + 1} of ${this.#count}, ${fixed(time, 1)} s`;
      setText(this.#place, `${position + 1} / ${this.#count} · ${fixed(time, 1)} s`);
      setAttribute(this.#slider, "aria-valuetext", words);
      this.#methods.forEach((method, at) => {
        const entry = method.found.frames[position];
        const pane = this.#panes[at];
        if (!entry || !pane) return;
        pane.count(method, position);
        const findings = findingsInWords(method.name, entry);
        pane.picture.show(image, entry, findings, this.#truth.checked);
      });
      setText(this.#trouble, images.trouble);
    }
    image?.close();
  }
}

customElements.define("observer-methods-split", MethodsSplit);
