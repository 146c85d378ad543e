/**
 * The side panel's tabs, following the keyboard pattern for tabs: arrows, Home and End.
 *
 * In a narrow window they form a bar at the bottom, with an additional first tab for what otherwise
 * is next to the panel; layout.css has the same limit.
 */

import { declareKeys } from "../elements/keys.js";

declareKeys("Tabs", ["← →", "Previous or next tab"], ["Home End", "First or last tab"]);

const KEY = "dynamic-observer.tab";
// What newcomers want next after watching: change something and see its effect.
const FIRST = "tab-parameters";
const VIEW = "tab-view";
const NARROW = matchMedia("(max-width: 59.99rem)");

class SideTabs extends HTMLElement {
  connectedCallback() {
    const tabs = this.#tabs();
    for (const tab of tabs) {
      tab.addEventListener("click", () => this.select(tab));
      tab.addEventListener("keydown", (event) => this.#move(event, tab));
    }
    NARROW.addEventListener("change", () => this.#fit());
    document.addEventListener("pane-wanted", (event) => {
      if (event instanceof CustomEvent && event.detail === "main" && NARROW.matches) this.#fit();
    });
    this.#fit();
  }

  /** Start with the view if there is room for one pane only, else with the last tab used. */
  #fit() {
    const wanted = NARROW.matches ? VIEW : (localStorage.getItem(KEY) ?? FIRST);
    const tabs = this.#tabs();
    const first = tabs.find((tab) => tab.id === wanted) ?? tabs.find((tab) => tab.id === FIRST);
    if (first) this.select(first);
  }

  /** @param {HTMLElement} chosen */
  select(chosen) {
    for (const tab of this.#tabs()) {
      const selected = tab === chosen;
      tab.setAttribute("aria-selected", String(selected));
      tab.tabIndex = selected ? 0 : -1;
      const panel = document.getElementById(tab.getAttribute("aria-controls") ?? "");
      // The view is the page itself, which the style sheet shows or hides.
      if (panel && tab.id !== VIEW) panel.hidden = !selected;
      // Hidden parts are not updated; let them catch up now.
      if (selected) panel?.dispatchEvent(new Event("shown"));
    }
    document.body.dataset.pane = chosen.id.replace("tab-", "");
    this.#reportToMain();
    if (chosen.id !== VIEW) localStorage.setItem(KEY, chosen.id);
  }

  /** Give the panel the main role while the page's main part is hidden. */
  #reportToMain() {
    const beside = document.querySelector("main")?.checkVisibility();
    this.closest("#panel")?.setAttribute("role", beside ? "complementary" : "main");
  }

  /**
   * @param {KeyboardEvent} event
   * @param {HTMLElement} tab
   */
  #move(event, tab) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const tabs = this.#tabs().filter((each) => each.checkVisibility());
    const at = tabs.indexOf(tab);
    /** @type {Record<string, number>} */
    const places = {
      ArrowRight: (at + 1) % tabs.length,
      ArrowLeft: (at + tabs.length - 1) % tabs.length,
      Home: 0,
      End: tabs.length - 1,
    };
    const next = tabs[places[event.key] ?? -1];
    if (!next) return;
    event.preventDefault();
    this.select(next);
    next.focus();
  }

  #tabs() {
    return /** @type {HTMLElement[]} */ ([...this.querySelectorAll('[role="tab"]')]);
  }
}

customElements.define("observer-tabs", SideTabs);
