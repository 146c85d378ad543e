/** The history: runs found again, looked at, compared. It takes the place of the live parts. */

import { button, h, setAttribute } from "../elements/dom.js";
import { giveBackFocus } from "../elements/focus-place.js";
import { Part } from "../elements/part.js";
import { CompareView } from "./compare-view.js";
import { RunSearch } from "./run-search.js";
import { RunView } from "./run-view.js";
import { placeOf } from "./run-words.js";
import { SavedClipList } from "./saved-clip-list.js";

/** Shows what the page's address names, so that it is kept, linked to and gone back from. */
class HistoryView extends Part {
  #search = new RunSearch();
  #savedClips = new SavedClipList();
  #run = new RunView();
  #compare = new CompareView();
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
      h("header.history-head", this.#title, this.#all, this.#leave),
      this.#search,
      this.#savedClips,
      this.#run,
      this.#compare,
    );
    for (const part of [this.#search, this.#savedClips, this.#run, this.#compare])
      part.attach(this.hub);
    this.#run.named = this.#compare.named = (words) => this.#name(words);
    this.#run.left = this.#savedClips.left = () => this.#close(true);
    this.hear("hashchange", () => this.#follow(true), window);
    // The calibration wizard wants the same place, and the focus with it.
    this.hear("calibrate", () => this.#close(false));
    this.#follow(false);
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
    if (shown === before) return;
    if (before === "" || before === "none") this.#caller = document.activeElement;
    this.#shown = shown;
    this.hidden = view === "none";
    document.body.toggleAttribute("data-history", view !== "none");
    this.hub.tell("history");
    this.#all.hidden = view === "list";
    this.#search.show(view === "list");
    this.#savedClips.show(view === "list");
    this.#run.show(view === "run" ? (ids[0] ?? "") : null);
    this.#compare.show(view === "compare" ? ids : []);
    this.#name(view === "compare" ? "Compare runs" : view === "run" ? "Run" : "Runs");
    if (!moved) return;
    this.closest("main")?.scrollTo({ top: 0 });
    // The keyboard goes on where the eye does.
    if (view !== "none") this.#title.focus();
    else giveBackFocus(this.#caller);
  }

  /** @param {string} words */
  #name(words) {
    if (this.#title.textContent !== words) this.#title.textContent = words;
  }
}

customElements.define("observer-history", HistoryView);
