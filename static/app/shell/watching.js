/**
 * Says that this browser only watches, and disables what it may not do.
 *
 * The server refuses a watcher every change, so here every control counts as one that changes
 * something, new ones included, unless it is marked as one that only looks: it or what it stands in
 * is listed below or has `data-looks`. `data-acts` marks what acts in such a place after all. The
 * nearest mark holds.
 */

import { h, setAttribute } from "../elements/dom.js";
import { access } from "./access.js";

const WATCHING_ONLY = "This link is read-only. Ask for an operator link to change anything.";

const LOOKS = [
  "[data-looks]",
  "[popovertarget]",
  '[type="search"]',
  '[role="tab"]',
  // What acts only asks in a dialog, and tells in a notice.
  "dialog",
  "#notices",
  // The page itself.
  "observer-keyboard-help",
  "observer-places",
  "observer-share",
  "observer-sign-out",
  "observer-splitter",
  "observer-theme-choice",
  "observer-tour",
  ".tour-card",
  // Whoever sees that something goes wrong stops the robots.
  "observer-stop",
  // What is live.
  "observer-live-views",
  "observer-log",
  "observer-obstacles",
  "observer-scene",
  "observer-speed-chart",
  "observer-status",
  // What was recorded.
  ".history-head",
  ".export-told",
  "observer-methods-split",
  "observer-run-chart",
  "observer-run-player",
  "observer-run-search",
  "observer-steps",
].join();
const ACTS = "[data-acts]";
const CONTROLS = "button, input, select, textarea";

class Watching extends HTMLElement {
  connectedCallback() {
    this.hidden = true;
    void this.#begin();
  }

  async #begin() {
    if ((await access()) === "operator") return;
    document.documentElement.dataset.access = "read_only";
    this.append(h("span.state-chip", { title: WATCHING_ONLY }, "Read-only"));
    this.append(h("span.visually-hidden", `. ${WATCHING_ONLY}`));
    this.hidden = false;
    lockAll(document.body);
    // Controls that are made, enabled or named later.
    new MutationObserver((changes) => {
      for (const { type, target, addedNodes } of changes) {
        const touched = type === "childList" ? addedNodes : [target];
        for (const node of touched) if (node instanceof HTMLElement) lockAll(node);
      }
    }).observe(document.body, {
      subtree: true,
      childList: true,
      attributeFilter: ["disabled", "title"],
    });
  }
}

/** @param {HTMLElement} part */
function lockAll(part) {
  if (part.matches(CONTROLS)) lock(part);
  for (const control of part.querySelectorAll(CONTROLS)) lock(control);
}

/** @param {Element} control */
function lock(control) {
  const marked = control.closest(`${LOOKS}, ${ACTS}`);
  if (marked && !marked.matches(ACTS)) return;
  setAttribute(control, "disabled", "");
  // The words beside a box are pointed at as well.
  for (const each of [control, control.closest("label")])
    if (each) setAttribute(each, "title", WATCHING_ONLY);
}

customElements.define("observer-watching", Watching);
