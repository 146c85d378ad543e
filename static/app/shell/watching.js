/** Says that this browser only watches, and disables what it may not do. */

import { h } from "../elements/dom.js";
import { access } from "./access.js";

// The parts in which everything that can be pressed or filled in changes something for everybody.
const CHANGING = [
  "observer-calibration",
  "observer-calibration-wizard",
  "observer-guard-check",
  "observer-live-truth",
  "observer-method-switch",
  "observer-parameters",
  "observer-playback",
  "observer-programmes",
  "observer-rig",
  "observer-robots",
  "observer-run-bar",
  "observer-source-picker",
];
// But not what only opens, finds or leads somewhere.
const LOOKING = '[data-looks], [data-looks] *, [popovertarget], [type="search"], [role="tab"]';
const CONTROLS = "button, input, select, textarea";

class Watching extends HTMLElement {
  connectedCallback() {
    this.hidden = true;
    void this.#begin();
  }

  async #begin() {
    if ((await access()) === "operator") return;
    document.documentElement.dataset.access = "read_only";
    const words = "This link is for watching. Ask for an operator link to change anything.";
    this.append(h("span.state-chip", { title: words }, "Watching only"));
    this.append(h("span.visually-hidden", `. ${words}`));
    this.hidden = false;
    for (const part of document.querySelectorAll(CHANGING.join())) lock(part);
  }
}

/**
 * Disable a part's controls, and those it makes or enables later.
 *
 * @param {Element} part
 */
function lock(part) {
  const disable = () => {
    for (const control of part.querySelectorAll(CONTROLS)) {
      if (!control.hasAttribute("disabled") && !control.matches(LOOKING))
        control.setAttribute("disabled", "");
    }
  };
  disable();
  new MutationObserver(disable).observe(part, {
    subtree: true,
    childList: true,
    attributeFilter: ["disabled"],
  });
}

customElements.define("observer-watching", Watching);
