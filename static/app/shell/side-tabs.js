/** The side panel's tabs, by the keyboard pattern for tabs: arrows, Home and End. */

const KEY = "dynamic-observer.tab";
// What a newcomer wants next after watching: to change something and see what it does.
const FIRST = "tab-parameters";

class SideTabs extends HTMLElement {
  connectedCallback() {
    const tabs = this.#tabs();
    for (const tab of tabs) {
      tab.addEventListener("click", () => this.select(tab));
      tab.addEventListener("keydown", (event) => this.#move(event, tab));
    }
    const remembered = localStorage.getItem(KEY);
    const first = tabs.find((tab) => tab.id === (remembered ?? FIRST)) ?? tabs[0];
    if (first) this.select(first);
  }

  /** @param {HTMLElement} chosen */
  select(chosen) {
    for (const tab of this.#tabs()) {
      const selected = tab === chosen;
      tab.setAttribute("aria-selected", String(selected));
      tab.tabIndex = selected ? 0 : -1;
      const panel = document.getElementById(tab.getAttribute("aria-controls") ?? "");
      if (panel) panel.hidden = !selected;
      // What is hidden is not kept up; now it is wanted.
      if (selected) panel?.dispatchEvent(new Event("shown"));
    }
    localStorage.setItem(KEY, chosen.id);
  }

  /**
   * @param {KeyboardEvent} event
   * @param {HTMLElement} tab
   */
  #move(event, tab) {
    const tabs = this.#tabs();
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
