/** Navigation between the live, recorded and method views, and the window's title. */

import { h, setAttribute, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { tourOffer } from "./tour.js";

const NAME = document.title;
const METHOD = "#steps";
/** Linked beside the switch of the methods. */
const COMPARE = "#methods";
/** @type {[href: string, words: string, title: string | null][]} */
const PAGES = [
  ["#live", "Live", null],
  ["#runs", "Runs", null],
  [METHOD, "Method", "The method, step by step"],
];
// Parts that replace the live ones; the first visible one provides the title.
const HEADINGS = ["observer-calibration-wizard", "observer-pages"].map(
  (part) => `${part}:not([hidden]) > header h2`,
);
/** What the first tab of a narrow window shows, by the beginning of the page's address. @type {[string, string][]} */
const VIEWS = [
  [METHOD, "Method"],
  [COMPARE, "Compare"],
  ["#runs/compare/", "Compare"],
  ["#runs/", "Run"],
  ["#runs", "All runs"],
];

class PageNav extends Part {
  #links = PAGES.map(([href, words, title]) => h("a", { href, title }, words));
  /** In the menu, for windows too narrow for the others. */
  #menuLinks = PAGES.map(([href, words]) => h("a.button", { href }, words));

  build() {
    this.append(h("nav", { "aria-label": "Pages" }, ...this.#links), tourOffer());
    const menu = document.querySelector("#page-menu");
    menu?.querySelector("nav")?.append(...this.#menuLinks);
    menu?.addEventListener("click", (event) => {
      if (event.target instanceof Element && event.target.closest("a"))
        /** @type {HTMLElement} */ (menu).hidePopover();
    });
    this.listen("page titled", () => this.#mark());
    this.#mark();
  }

  #mark() {
    const away = document.body.hasAttribute("data-away");
    const here = away ? pageOf(location.hash) : "#live";
    for (const links of [this.#links, this.#menuLinks])
      links.forEach((link, at) =>
        setAttribute(link, "aria-current", PAGES[at]?.[0] === here ? "page" : null),
      );
    const tab = document.getElementById("tab-view");
    if (tab) setText(tab, away ? viewAt(location.hash) : "View");
    const [heading] = HEADINGS.flatMap((selector) => document.querySelector(selector) ?? []);
    document.title = heading ? `${heading.textContent} · ${NAME}` : NAME;
  }
}

/** @param {string} hash of a page other than the live one @returns {string} the page it belongs to */
function pageOf(hash) {
  return [METHOD, COMPARE].find((page) => hash.startsWith(page)) ?? "#runs";
}

/** @param {string} hash of the page's address @returns {string} the name of what is shown there */
export function viewAt(hash) {
  return VIEWS.find(([begin]) => hash.startsWith(begin))?.[1] ?? "View";
}

customElements.define("observer-page-nav", PageNav);
