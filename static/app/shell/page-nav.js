/** Navigation between the live, recorded and method views, and the window's title. */

import { h, setAttribute } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { tourOffer } from "./tour.js";

const NAME = document.title;
const METHOD = "#steps";
// Parts that replace the live ones; the first visible one provides the title.
const HEADINGS = ["observer-calibration-wizard", "observer-history"].map(
  (part) => `${part}:not([hidden]) > header h2`,
);

class PageNav extends Part {
  #live = h("a", { href: "#live" }, "Live");
  #runs = h("a", { href: "#history" }, "Runs");
  #method = h("a", { href: METHOD, title: "The method, step by step" }, "Method");

  build() {
    this.append(
      h("nav", { "aria-label": "Pages" }, this.#live, this.#runs, this.#method),
      tourOffer(),
    );
    this.listen("history titled", () => this.#mark());
    this.#mark();
  }

  #mark() {
    const away = document.body.hasAttribute("data-history");
    const method = location.hash.startsWith(METHOD);
    const here = !away ? this.#live : method ? this.#method : this.#runs;
    for (const each of [this.#live, this.#runs, this.#method])
      setAttribute(each, "aria-current", each === here ? "page" : null);
    const [heading] = HEADINGS.flatMap((selector) => document.querySelector(selector) ?? []);
    document.title = heading ? `${heading.textContent} · ${NAME}` : NAME;
  }
}

customElements.define("observer-page-nav", PageNav);
