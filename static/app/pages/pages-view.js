/** The pages that replace the live parts: runs, comparisons, the method. */

import { button, h, setAttribute } from "../elements/dom.js";
import { focusHeading, restoreFocus } from "../elements/focus.js";
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

/** Shows what the page's address names, so bookmarks, links and the Back button work. */
class PagesView extends Part {
  #search = new RunSearch();
  #savedClips = new SavedClipList();
  #run = new RunView();
  #compare = new CompareView();
  #methods = new MethodsView();
  #steps = new StepsView();
  #leave = button("Back to live", () => this.#close(true));
  #title = h("h2", { id: "page-title", tabindex: "-1" }, "Runs");
  #all = h("a.button", { href: "#runs" }, "All runs");
  #shown = "";
  /** The element that had the focus when the first of them was opened. @type {Element | null} */
  #caller = null;

  build() {
    setAttribute(this, "role", "region");
    setAttribute(this, "aria-labelledby", "page-title");
    const parts = [
      this.#search,
      this.#savedClips,
      this.#run,
      this.#compare,
      this.#methods,
      this.#steps,
    ];
    this.append(
      h("header.page-head", this.#title, this.#run.actions, this.#all, this.#leave),
      ...parts,
    );
    for (const part of parts) part.attach(this.hub);
    this.#run.named = this.#compare.named = (words) => this.#name(words);
    this.#run.left = this.#savedClips.left = () => this.#close(true);
    this.listen("hashchange", () => this.#follow(true), window);
    // The calibration wizard needs the same place and takes the focus.
    this.listen("calibrate", () => this.#close(false));
    // If the page was up before this view, the user came here while the view was loading.
    const started = !document.body.hasAttribute("data-starting");
    this.#follow(started && placeOf(location.hash).view !== "none");
  }

  /** @param {boolean} asked whether the user asked for the live parts */
  #close(asked) {
    if (this.hidden) return;
    history.pushState(null, "", location.pathname + location.search);
    this.#follow(asked);
  }

  /** @param {boolean} moved whether the user navigated here */
  #follow(moved) {
    const { view, ids } = placeOf(location.hash);
    const shown = [view, ...ids].join("/");
    const before = this.#shown;
    // The address of the steps contains everything they show.
    this.#steps.show(view === "steps" ? location.hash : null);
    if (shown === before) return;
    if (before === "" || before === "none") this.#caller = document.activeElement;
    this.#shown = shown;
    this.hidden = view === "none";
    setAttribute(document.body, "data-away", view === "none" ? null : view);
    this.hub.emit("page");
    this.#all.hidden = !["run", "compare"].includes(view);
    this.#search.show(view === "list");
    this.#savedClips.show(view === "list");
    this.#run.show(view === "run" ? (ids[0] ?? "") : null);
    this.#compare.show(view === "compare" ? ids : []);
    this.#methods.show(view === "methods" ? ids : null);
    this.#name(TITLES[view]);
    if (!moved) return;
    if (view !== "none") openPane("main");
    this.closest("main")?.scrollTo({ top: 0 });
    // The focus follows to the view now shown.
    if (view !== "none") focusHeading(this.#title);
    else restoreFocus(this.#caller);
  }

  /** @param {string} words */
  #name(words) {
    if (this.#title.textContent === words) return;
    this.#title.textContent = words;
    this.hub.emit("titled");
  }
}

customElements.define("observer-pages", PagesView);
