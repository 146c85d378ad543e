/** Leads back from a run's recording to the source that was open before it. */

import { button, h, icon, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { notify, exclusiveRunner } from "../shell/notice.js";

/** Hidden while no recording of a run is open. */
export class BackToSource extends Part {
  #words = h("span");
  #name = h("span");
  #back = button([icon("undo"), this.#name], () => this.#do(() => this.#go()));
  #error = h("p.field-error", { role: "alert" });
  #do = exclusiveRunner(() => {}, this.#error);

  build() {
    this.append(h("p", this.#words, this.#back), this.#error);
    this.listen("status", () => this.#render());
    this.#render();
  }

  #render() {
    const source = this.hub.status?.source ?? null;
    this.hidden = !source?.before;
    if (!source?.before) return;
    setText(this.#words, `Playing: ${source.name}`);
    setText(this.#name, `Back to ${source.before}`);
  }

  async #go() {
    this.hub.applyStatus(await request("POST", "/source/back"));
    notify(`Source: ${this.hub.status?.source?.name ?? "open again"}.`);
  }
}

customElements.define("observer-back-to-source", BackToSource);
