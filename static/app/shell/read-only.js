/**
 * Shows that this browser has read-only access, and disables what it may not do.
 *
 * The server refuses any change by a watcher, so every control, including new ones, counts as
 * changing something unless it is marked as harmless: it or an ancestor is listed below or has
 * `data-harmless`. Within such an element, `data-changing` marks controls that do change something.
 * The nearest mark wins.
 */

import { h, setAttribute } from "../elements/dom.js";
import { WATCHING_ONLY } from "../elements/facts.js";
import { access } from "./access.js";

const HARMLESS = [
  "[data-harmless]",
  "[popovertarget]",
  '[type="search"]',
  '[role="tab"]',
  // Dialogs only ask and notices only report; the controls that open them are disabled.
  "dialog",
  "#notices",
  // The page itself.
  "observer-keyboard-help",
  "observer-page-nav",
  "observer-share",
  "observer-sign-out",
  "observer-splitter",
  "observer-theme-choice",
  "observer-tour",
  ".tour-card",
  // Anyone who sees something go wrong may stop the robots.
  "observer-stop",
  "observer-stop-line",
  // Live parts.
  "observer-live-views",
  "observer-log",
  "observer-obstacles",
  "observer-scene",
  "observer-speed-chart",
  "observer-status",
  // Recordings.
  ".page-head",
  ".export-message",
  "observer-methods-split",
  "observer-run-chart",
  "observer-run-player",
  "observer-run-search",
  "observer-steps",
].join();
const CHANGING = "[data-changing]";
const CONTROLS = "button, input, select, textarea";

class ReadOnlyBadge extends HTMLElement {
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
    // Controls that are created, enabled or renamed later.
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
  const marked = control.closest(`${HARMLESS}, ${CHANGING}`);
  if (marked && !marked.matches(CHANGING)) return;
  setAttribute(control, "disabled", "");
  // The label of a checkbox needs the tooltip as well.
  for (const each of [control, control.closest("label")])
    if (each) setAttribute(each, "title", WATCHING_ONLY);
}

customElements.define("observer-read-only", ReadOnlyBadge);
