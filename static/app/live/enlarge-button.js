/** Enlarges a part of the page to the whole window below header and headline, and restores it. */

import { h, setAttribute, setText, svg } from "../elements/dom.js";
import { declareKeys, isCovered } from "../elements/keys.js";
import { Part } from "../elements/part.js";

declareKeys("Enlarged view", ["Esc", "Restore it"]);

const LARGER =
  "M9.5 2H14v4.5h-1.6V4.7L9.2 7.9 8.1 6.8l3.2-3.2H9.5zM2 9.5h1.6v1.8l3.2-3.2 1.1 1.1-3.2 3.2h1.8V14H2z";
const SMALLER =
  "M13.9 3.2 10.7 6.4h1.8V8H8V3.5h1.6v1.8l3.2-3.2zM3.5 8H8v4.5H6.4v-1.8l-3.2 3.2-1.1-1.1 3.2-3.2H3.5z";

/**
 * The stop button and the age of the data stay visible; everything else is out of reach. Esc
 * restores the part unless a robot is armed, in which case it stops the robots; the button always
 * restores it.
 */
export class EnlargeButton extends Part {
  #path = svg("path", { d: LARGER });
  #word = h("span.enlarge-word");
  #button = h(
    "button.button.icon-button",
    { type: "button" },
    svg("svg", { viewBox: "0 0 16 16", class: "icon", "aria-hidden": "true" }, this.#path),
    this.#word,
  );
  #back = new AbortController();
  /** Scroll positions of the ancestors before enlarging. @type {[Element, number][]} */
  #scrolled = [];

  /** The element to enlarge. @type {HTMLElement} */
  what = this;
  /** Its name, as in "Enlarge the left view". */
  name = "";

  build() {
    this.append(this.#button);
    this.#button.addEventListener("click", () => this.#set(!this.#enlarged));
    this.#render();
  }

  disconnectedCallback() {
    super.disconnectedCallback();
    this.#set(false);
  }

  get #enlarged() {
    return this.what.hasAttribute("data-enlarged");
  }

  /** @param {boolean} enlarged */
  #set(enlarged) {
    if (enlarged === this.#enlarged) return;
    if (enlarged) this.#scrolled = scrollPositionsAround(this.what);
    this.what.toggleAttribute("data-enlarged", enlarged);
    document.body.toggleAttribute("data-enlarged", enlarged);
    if (enlarged) this.#listen();
    else {
      this.#back.abort();
      for (const [element, top] of this.#scrolled) element.scrollTop = top;
    }
    this.#render();
  }

  #listen() {
    this.#back.abort();
    this.#back = new AbortController();
    const { signal } = this.#back;
    document.addEventListener("keydown", (event) => this.#key(event), { signal });
    const sizes = new ResizeObserver(() => {
      // Something else replaced it, such as a recorded run.
      if (this.what.getClientRects().length === 0) this.#set(false);
      else updateEnlargedTop();
    });
    for (const each of [this.what, document.body, ...fixedElements()]) sizes.observe(each);
    signal.addEventListener("abort", () => sizes.disconnect());
    updateEnlargedTop();
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.key !== "Escape" || event.defaultPrevented) return;
    if (isCovered()) return;
    event.preventDefault();
    this.#set(false);
  }

  #render() {
    const enlarged = this.#enlarged;
    setAttribute(this.#path, "d", enlarged ? SMALLER : LARGER);
    setText(this.#word, enlarged ? "Restore" : "Enlarge");
    const words = enlarged ? `Restore the ${this.name}` : `Enlarge the ${this.name}`;
    setAttribute(this.#button, "aria-label", words);
    setAttribute(this.#button, "title", words);
  }
}

/** Return the elements that stay visible above. */
function fixedElements() {
  return document.querySelectorAll("body > header, observer-headline");
}

/** Tell the style sheet where they end. */
function updateEnlargedTop() {
  const ends = [...fixedElements()].map((each) => each.getBoundingClientRect().bottom);
  document.documentElement.style.setProperty("--enlarged-top", `${Math.max(0, ...ends)}px`);
}

/** @param {HTMLElement} element @returns {[Element, number][]} ancestors' scroll positions */
function scrollPositionsAround(element) {
  /** @type {[Element, number][]} */
  const found = [];
  for (let each = element.parentElement; each; each = each.parentElement)
    if (each.scrollTop > 0) found.push([each, each.scrollTop]);
  return found;
}

customElements.define("observer-enlarge-button", EnlargeButton);
