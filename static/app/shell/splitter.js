/** A bar between two panes, dragged or moved by arrow keys; it remembers its position. */

import { button, h, setAttribute, svg } from "../elements/dom.js";
import { declareKeys } from "../elements/keys.js";

declareKeys("Bar between panes", ["↑ ← ↓ →", "Resize the pane"], ["Enter", "Close or open it"]);

const KEY = "dynamic-observer.pane.";
const STEP_PX = 24;
// The smallest useful pane, and the largest share of the window it may take.
const MIN_PX = 160;
const MAX_SHARE = 0.7;

/**
 * Sets the size of the pane after it (to its right, or below), named by `pane`, as the custom
 * property `--pane-size-<id>` of the page, and closes and opens that pane. Where panes are not side
 * by side, the style sheet hides the bar.
 */
class Splitter extends HTMLElement {
  #bar = h("div.splitter-bar", { role: "separator", tabindex: "0" });
  #toggle = button(chevron(), () => this.#close(!this.#closed), { class: "splitter-toggle" });
  #pane = this.getAttribute("pane") ?? "";
  #words = this.getAttribute("label") ?? "pane";
  #upright = !this.hasAttribute("level");
  #closed = false;

  connectedCallback() {
    if (this.childElementCount) return;
    this.append(this.#bar, this.#toggle);
    for (const each of [this.#bar, this.#toggle]) setAttribute(each, "aria-controls", this.#pane);
    setAttribute(this.#bar, "aria-orientation", this.#upright ? "vertical" : "horizontal");
    setAttribute(this.#bar, "aria-label", `Size of the ${this.#words}`);
    this.#bar.addEventListener("pointerdown", (event) => this.#drag(event));
    this.#bar.addEventListener("dblclick", () => this.#close(!this.#closed));
    this.#bar.addEventListener("keydown", (event) => this.#key(event));
    document.addEventListener("pane-wanted", (event) => {
      if (event instanceof CustomEvent && event.detail === this.#pane) this.#close(false);
    });
    const { size = null, closed = false } = loadStored(this.#pane);
    if (typeof size === "number") this.#resize(size, false);
    else requestAnimationFrame(() => this.#describe(this.#size()));
    this.#close(Boolean(closed), false);
  }

  /** @param {PointerEvent} event */
  #drag(event) {
    if (event.button !== 0) return;
    const stop = new AbortController();
    const { signal } = stop;
    this.#bar.setPointerCapture(event.pointerId);
    this.#bar.addEventListener(
      "pointermove",
      (move) => {
        const { right, bottom } = this.#rectangle();
        this.#resize(this.#upright ? right - move.clientX : bottom - move.clientY);
      },
      { signal },
    );
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"])
      this.#bar.addEventListener(end, () => stop.abort(), { signal });
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const larger = this.#upright ? "ArrowLeft" : "ArrowUp";
    const smaller = this.#upright ? "ArrowRight" : "ArrowDown";
    const size = this.#size();
    if (event.key === "Enter") this.#close(!this.#closed);
    else if (event.key === larger) this.#resize(size + STEP_PX);
    else if (event.key === smaller) this.#resize(size - STEP_PX);
    else return;
    // Elsewhere on the page arrow keys drive; a handled one must not.
    event.preventDefault();
  }

  #size() {
    const { width, height } = this.#rectangle();
    return this.#upright ? width : height;
  }

  /** Tell screen readers the size in per cent of the window. @param {number} size */
  #describe(size) {
    const share = (100 * size) / (this.#upright ? innerWidth : innerHeight);
    setAttribute(this.#bar, "aria-valuenow", String(Math.round(share)));
  }

  #rectangle() {
    const pane = document.getElementById(this.#pane);
    return (pane ?? this).getBoundingClientRect();
  }

  /** @param {number} size CSS pixels @param {boolean} [keep] */
  #resize(size, keep = true) {
    const most = MAX_SHARE * (this.#upright ? innerWidth : innerHeight);
    const taken = Math.round(Math.min(Math.max(size, MIN_PX), Math.max(most, MIN_PX)));
    document.documentElement.style.setProperty(`--pane-size-${this.#pane}`, `${taken}px`);
    this.#describe(taken);
    if (keep) this.#remember({ size: taken });
  }

  /** @param {boolean} closed @param {boolean} [keep] */
  #close(closed, keep = true) {
    this.#closed = closed;
    document.body.toggleAttribute(`data-closed-${this.#pane}`, closed);
    setAttribute(this.#toggle, "aria-expanded", String(!closed));
    const words = `${closed ? "Open" : "Close"} the ${this.#words}`;
    setAttribute(this.#toggle, "aria-label", words);
    setAttribute(this.#toggle, "title", words);
    if (keep) this.#remember({ closed });
  }

  /** @param {{size?: number, closed?: boolean}} changed */
  #remember(changed) {
    const value = JSON.stringify({ ...loadStored(this.#pane), ...changed });
    localStorage.setItem(KEY + this.#pane, value);
  }
}

/**
 * Open a pane that a splitter may have closed, to show something in it.
 *
 * @param {string} pane its id
 */
export function openPane(pane) {
  document.dispatchEvent(new CustomEvent("pane-wanted", { detail: pane }));
}

/** @param {string} pane @returns {{size?: unknown, closed?: unknown}} */
function loadStored(pane) {
  try {
    const value = JSON.parse(localStorage.getItem(KEY + pane) ?? "{}");
    return value && typeof value === "object" ? value : {};
  } catch {
    return {};
  }
}

function chevron() {
  return svg(
    "svg",
    { viewBox: "0 0 8 16", class: "splitter-chevron", "aria-hidden": "true" },
    svg("path", { d: "M2 4l4 4-4 4" }),
  );
}

customElements.define("observer-splitter", Splitter);
