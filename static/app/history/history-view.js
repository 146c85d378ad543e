/** The history: runs found again, looked at, compared. It takes the place of the live parts. */

import { button, h, setAttribute } from "../elements/dom.js";
import { giveBackFocus } from "../elements/focus-place.js";
import { Part } from "../elements/part.js";
import { StepsView } from "../method/steps-view.js";
import { openPane } from "../shell/splitter.js";
import { CompareView } from "../runs/compare-view.js";
import { MethodsView } from "../runs/methods-view.js";
import { RunSearch } from "../runs/run-search.js";
import { RunView } from "../runs/run-view.js";
import { placeOf } from "../runs/run-words.js";
import { SavedClipList } from "../runs/saved-clip-list.js";

const TITLES = {
  none: "Runs",
  list: "Runs",
  run: "Run",
  compare: "Compare runs",
  methods: "Compare methods",
  steps: "The method, step by step",
};

/** Shows what the page's address names, so that it is kept, linked to and gone back from. */
class HistoryView extends Part {
  #search = new RunSearch();
  #savedClips = new SavedClipList();
  #run = new RunView();
  #compare = new CompareView();
  #methods = new MethodsView();
  #steps = new StepsView();
  #leave = button("Back to live", () => this.#close(true));
  #title = h("h2", { id: "history-title", tabindex: "-1" }, "Runs");
  #all = h("a.button", { href: "#history" }, "All runs");
  #shown = "";
  /** The element that had the focus when the history was called. @type {Element | null} */
  #caller = null;

  build() {
    setAttribute(this, "role", "region");
    setAttribute(this, "aria-labelledby", "history-title");
    this.append(
      h("header.history-head", this.#title, this.#run.actions, this.#all, this.#leave),
      this.#search,
      this.#savedClips,
      this.#run,
      this.#compare,
      this.#methods,
      this.#steps,
    );
    for (const part of [
      this.#search,
      this.#savedClips,
      this.#run,
      this.#compare,
      this.#methods,
      this.#steps,
    ])
      part.attach(this.hub);
    this.#run.named = this.#compare.named = (words) => this.#name(words);
    this.#run.left = this.#savedClips.left = () => this.#close(true);
    this.hear("hashchange", () => this.#follow(true), window);
    // The calibration wizard wants the same place, and the focus with it.
    this.hear("calibrate", () => this.#close(false));
    // Where the page was there before this view, somebody came here while it was loaded.
    const started = !document.body.hasAttribute("data-starting");
    this.#follow(started && placeOf(location.hash).view !== "none");
  }

  /** @param {boolean} asked for the live parts, not for something else */
  #close(asked) {
    if (this.hidden) return;
    history.pushState(null, "", location.pathname + location.search);
    this.#follow(asked);
  }

  /** @param {boolean} moved by somebody at this page */
  #follow(moved) {
    const { view, ids } = placeOf(location.hash);
    const shown = [view, ...ids].join("/");
    const before = this.#shown;
    // Its own address has all that it shows.
    this.#steps.show(view === "steps" ? location.hash : null);
    if (shown === before) return;
    if (before === "" || before === "none") this.#caller = document.activeElement;
    this.#shown = shown;
    this.hidden = view === "none";
    document.body.toggleAttribute("data-history", view !== "none");
    this.hub.tell("history");
    this.#all.hidden = view === "list" || view === "steps";
    this.#search.show(view === "list");
    this.#savedClips.show(view === "list");
    this.#run.show(view === "run" ? (ids[0] ?? "") : null);
    this.#compare.show(view === "compare" ? ids : []);
    this.#methods.show(view === "methods" ? ids : null);
    this.#name(TITLES[view]);
    if (!moved) return;
    if (view !== "none") openPane("main");
    this.closest("main")?.scrollTo({ top: 0 });
    // The keyboard goes on where the eye does.
    if (view !== "none") this.#title.focus();
    else giveBackFocus(this.#caller);
  }

  /** @param {string} words */
  #name(words) {
    if (this.#title.textContent === words) return;
    this.#title.textContent = words;
    this.hub.tell("titled");
  }
}

customElements.define("observer-history", HistoryView);
