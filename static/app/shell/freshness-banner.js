/** One line across the page while what it shows is old. */

import { h, setAttribute, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";

class FreshnessBanner extends Part {
  #text = h("span");
  #age = h("span.figure", { "aria-hidden": "true" });

  build() {
    setAttribute(this, "role", "status");
    this.append(h("p", this.#text, " ", this.#age));
    this.hear("freshness", () => this.#render());
    this.#render();
    setInterval(() => this.#renderAge(), 500);
  }

  #render() {
    const { state, reason } = this.hub.freshness;
    document.documentElement.dataset.freshness = state;
    this.hidden = state !== "stale";
    setText(this.#text, state === "stale" ? `Stale: ${reason}` : "");
    this.#renderAge();
  }

  #renderAge() {
    const { state, age_s } = this.hub.freshness;
    const known = state === "stale" && age_s > 0;
    setText(this.#age, known ? `The data shown is ${age_s.toFixed(0)} s old.` : "");
  }
}

customElements.define("observer-freshness-banner", FreshnessBanner);
