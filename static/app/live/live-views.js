/** The live views chosen by the user. */

import { h } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { LiveView, VIEWS } from "./live-view.js";

const KEY = "dynamic-observer.views";
const FIRST_CHOICE = ["left", "residual"];
const OFFERED = ["left", "warped", "disparity", "residual"];

class LiveViews extends Part {
  #grid = h("div.views-grid");
  #choice = h("fieldset.chips", h("legend.visually-hidden", "Views shown"));
  /** @type {Map<string, LiveView>} */
  #shown = new Map();

  build() {
    const heading = h("div.pane-head", h("h2.visually-hidden", "Live views"), this.#choice);
    this.append(heading, this.#grid);
    this.#offer();
  }

  #offer() {
    const chosen = loadStored();
    for (const name of OFFERED) {
      const box = h("input", { type: "checkbox", name: "view", value: name });
      box.checked = chosen.includes(name);
      box.addEventListener("change", () => this.#choose());
      this.#choice.append(
        h("label", { title: VIEWS[name]?.help }, box, VIEWS[name]?.title ?? name),
      );
    }
    this.#choose();
  }

  #choose() {
    const boxes = [...this.#choice.querySelectorAll("input")];
    const chosen = boxes.filter((box) => box.checked).map((box) => box.value);
    localStorage.setItem(KEY, chosen.join(","));
    for (const [name, view] of this.#shown) {
      if (!chosen.includes(name)) {
        view.remove();
        this.#shown.delete(name);
      }
    }
    for (const [place, name] of chosen.entries()) {
      if (!this.#shown.has(name)) {
        this.#grid.insertBefore(this.#make(name), this.#grid.children[place] ?? null);
      }
    }
    this.#grid.toggleAttribute("data-empty", chosen.length === 0);
    document.body.dataset.views = String(chosen.length);
  }

  /** @param {string} name */
  #make(name) {
    const view = new LiveView();
    view.name = name;
    view.enlarges = true;
    view.attach(this.hub);
    this.#shown.set(name, view);
    return view;
  }
}

function loadStored() {
  const text = localStorage.getItem(KEY);
  return text === null ? FIRST_CHOICE : text.split(",");
}

customElements.define("observer-live-views", LiveViews);
