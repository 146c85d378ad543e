/** An optional tour of the page: one card that moves from part to part. */

import { button, h, setText } from "../elements/dom.js";
import { restoreFocus } from "../elements/focus.js";
import { openPane } from "./splitter.js";

const KEY = "dynamic-observer.tour";
const WANTED = "tour-wanted";
const GAP_PX = 10;

/** Stops of the tour: selector, heading and purpose of each part. */
const STOPS = /** @type {const} */ ([
  [
    "observer-headline",
    "What moves",
    "The nearest moving obstacle in one sentence: its speed with the 95 % interval, its heading and distance, and the ground truth where the source has it.",
  ],
  [
    "observer-scene",
    "Where it is",
    "The point cloud of the stereo camera. Boxes are obstacles, arrows show where each will be in one second. Drag to orbit, scroll to zoom.",
  ],
  [
    "#views",
    "Why it counts as moving",
    "The images behind the result. Click any point of the left view to ask why it counts as moving or not.",
  ],
  [
    "#measured",
    "How fast it is",
    "Estimated speeds against ground truth. The shading is the 95 % interval.",
  ],
  [
    "observer-method-switch",
    "Two methods",
    "Switch between the published method and ours while the source runs, or compare both on the same frames.",
  ],
  [
    "#tab-parameters",
    "Tune it",
    "Thresholds take effect on the next frame. Undo reverts a change.",
  ],
  [
    "#tab-source",
    "Your own data",
    "Open two webcams, a recording, a folder of images or another simulated scene.",
  ],
  [
    "#stop-robots",
    "Stop",
    "Stops every robot, from every page. While a robot is armed, Space and Esc do the same.",
  ],
]);

class Tour extends HTMLElement {
  #words = h("p");
  #title = h("h2");
  #count = h("span.hint.figure");
  #back = button("Back", () => this.#go(this.#at - 1));
  #next = button("Next", () => this.#go(this.#at + 1), { class: "button primary" });
  #card = h(
    "div.tour-card",
    { popover: "manual", role: "dialog", "aria-label": "Tour", tabindex: "-1" },
    this.#title,
    this.#words,
    h(
      "div.row",
      this.#count,
      button("Close", () => this.#end(), { class: "button tour-close" }),
      this.#back,
      this.#next,
    ),
  );
  #at = 0;
  /** The element that had the focus when the tour began. @type {Element | null} */
  #caller = null;
  /** @type {Element[]} */
  #shown = [];

  connectedCallback() {
    if (this.childElementCount) return;
    this.append(button("Take the tour", () => this.#begin()));
    // Outside the menu, which closes while the card is open.
    document.body.append(this.#card);
    this.#card.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.#end();
    });
    window.addEventListener("resize", () => this.#place());
    document.addEventListener(WANTED, () => this.#begin());
  }

  async #begin() {
    localStorage.setItem(KEY, "taken");
    this.#caller = document.activeElement;
    document.getElementById("page-menu")?.hidePopover();
    openPane("main");
    if (document.body.hasAttribute("data-away")) {
      // The live parts are shown again when the page has followed its address.
      const moved = new Promise((resolve) =>
        window.addEventListener("hashchange", resolve, { once: true }),
      );
      location.hash = "#live";
      await moved;
    }
    this.#card.showPopover();
    this.#go(0);
    this.#card.focus();
  }

  #end() {
    this.#mark(null);
    this.#card.hidePopover();
    restoreFocus(this.#caller);
  }

  /** @param {number} at */
  #go(at) {
    // Skip parts that this window has no room for.
    const stops = STOPS.filter(([selector]) => document.querySelector(selector)?.checkVisibility());
    const stop = stops[at];
    if (!stop) return this.#end();
    this.#at = at;
    const [selector, title, words] = stop;
    setText(this.#title, title);
    setText(this.#words, words);
    setText(this.#count, `${at + 1} of ${stops.length}`);
    this.#back.hidden = at === 0;
    setText(this.#next, at === stops.length - 1 ? "Done" : "Next");
    this.#mark(document.querySelector(selector));
  }

  /** @param {Element | null} part */
  #mark(part) {
    for (const each of this.#shown) each.removeAttribute("data-toured");
    this.#shown = part ? [part] : [];
    part?.setAttribute("data-toured", "");
    part?.scrollIntoView();
    this.#place();
  }

  /** Place the card below or above the part if it fits, else over its middle, within the window. */
  #place() {
    const [part] = this.#shown;
    if (!part) return;
    const { left, right, top, bottom } = part.getBoundingClientRect();
    const { width, height } = this.#card.getBoundingClientRect();
    const below = bottom + GAP_PX + height < innerHeight;
    const above = top - GAP_PX - height > 0;
    const y = below ? bottom + GAP_PX : above ? top - GAP_PX - height : (top + bottom - height) / 2;
    const x = Math.min(Math.max((left + right - width) / 2, GAP_PX), innerWidth - width - GAP_PX);
    this.#card.style.left = `${Math.max(x, GAP_PX)}px`;
    this.#card.style.top = `${Math.min(Math.max(y, GAP_PX), innerHeight - height - GAP_PX)}px`;
  }
}

/** Make a button that offers the tour to users who have not taken it. */
export function tourOffer() {
  const offer = button("Tour", () => document.dispatchEvent(new Event(WANTED)), {
    class: "quiet tour-offer",
    title: "One minute, and you can leave it at any time",
    hidden: localStorage.getItem(KEY) !== null,
  });
  offer.addEventListener("click", () => {
    offer.hidden = true;
  });
  return offer;
}

customElements.define("observer-tour", Tour);
