/** The runs that were kept. */

import { request } from "./api.js";
import { h, icon } from "./dom.js";
import { confirmed, notify, notifyError } from "./notice.js";
import { Part } from "./part.js";
import { duration, when } from "./words.js";

/** @typedef {import("./types.js").Run} Run */

class RunList extends Part {
  #list = h("ul", { class: "item-list" });
  #empty = h("p", { class: "empty" }, "No run yet. Start one at the top of the page; its speeds are kept and can be downloaded as CSV.");
  /** @type {string | null} */
  #runId = null;

  build() {
    this.append(h("h2", {}, "Runs"), this.#empty, this.#list);
    this.hear("runs", () => void this.#load());
    this.hear("reconnected", () => void this.#load());
    this.hear("status", () => {
      const id = this.hub.status?.run?.id ?? null;
      if (id === this.#runId) return;
      this.#runId = id;
      void this.#load();
    });
    void this.#load();
  }

  async #load() {
    /** @type {Run[] | null} */
    const runs = await request("GET", "/runs").catch(() => null);
    if (!runs) return;
    this.#empty.hidden = runs.length > 0;
    const newestFirst = [...runs].sort((a, b) => b.started_at.localeCompare(a.started_at));
    this.#list.replaceChildren(...newestFirst.map((run) => this.#item(run)));
  }

  /** @param {Run} run */
  #item(run) {
    const path = `/runs/${encodeURIComponent(run.id)}`;
    const remove = h("button", { type: "button", class: "button icon-button", disabled: run.state === "running", "aria-label": `Delete run ${run.name}`, title: "Delete" }, icon("trash"));
    remove.addEventListener("click", () => void this.#remove(run, path));
    const facts = [
      run.source,
      when(run.started_at),
      duration(run.started_at, run.ended_at),
      `${run.frames} frames`,
      run.segments > 1 ? `${run.segments} segments` : null,
    ].filter(Boolean);
    return h(
      "li",
      {},
      h("div", { class: "item-words" },
        h("p", {}, h("b", {}, run.name), " ", h("span", { class: "state-chip", "data-state": run.state }, run.state)),
        h("p", { class: "hint" }, facts.join(" · ")),
        run.reason ? h("p", { class: "hint" }, run.reason) : null),
      h("div", { class: "row" },
        h("a", { class: "button", href: `/api${path}/speeds?format=csv`, download: `${run.name}.csv`, "aria-label": `Speeds of run ${run.name} as CSV` }, icon("download"), "CSV"),
        remove),
    );
  }

  /**
   * @param {Run} run
   * @param {string} path
   */
  async #remove(run, path) {
    const sure = await confirmed(`Delete run ${run.name}?`, `Its ${run.frames} frames of speeds are deleted with it and cannot be brought back.`, "Delete run");
    if (!sure) return;
    try {
      await request("DELETE", path);
      notify(`Run ${run.name} deleted.`);
    } catch (error) {
      notifyError(error);
    }
    this.hub.tell("runs");
  }
}

customElements.define("observer-runs", RunList);
