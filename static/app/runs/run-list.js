/** The newest runs, and a link to all of them. */

import { button, downloadLink, h, iconButton, item, stateChip } from "../elements/dom.js";
import { KeyedList } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { fixed, sentence } from "../elements/words.js";
import { request } from "../shell/api.js";
import { attempt, notify } from "../shell/notice.js";
import { removeRun } from "./run-search.js";
import { facts, activeRunIds, isEmpty, runHref, size } from "./run-words.js";

/** @import { ClipFile, History, Run } from "../contract" */

// Older ones are under All runs.
const NEWEST = 8;

class RunList extends Part {
  #list = h("ul.item-list");
  #items = new KeyedList(
    this.#list,
    (/** @type {Run} */ run) => this.#item(run),
    () => this.#all,
  );
  #empty = h(
    "p.empty",
    "No runs yet. Start a run at the top of the page to record it and list it here.",
  );
  #all = h("a.button.primary", { href: "#runs" }, "All runs");
  #save = button("Save last 30 s", () => this.#saveClip(), {
    "aria-describedby": "save-clip-help",
  });
  #going = "";

  build() {
    this.append(
      h("h2", "Runs"),
      h("div.row", this.#all, this.#save),
      h(
        "p.hint",
        { id: "save-clip-help" },
        "The last 30 s are buffered with live cameras and during every run. They are also saved when the guard stops a robot.",
      ),
      h("div.stack.recent-runs", h("h3", "Recent runs"), this.#empty, this.#list),
    );
    this.listen("runs reconnected", () => this.#load());
    this.listen("status", () => {
      const going = activeRunIds(this.hub.status);
      if (going === this.#going) return;
      this.#going = going;
      void this.#load();
    });
    void this.#load();
  }

  async #load() {
    /** @type {History | null} */
    const found = await request("GET", `/history?limit=${NEWEST}`).catch(() => null);
    if (!found) return;
    this.#empty.hidden = found.runs.length > 0;
    this.#items.show(found.runs, ({ id }) => id);
  }

  async #saveClip() {
    await attempt(async () => {
      /** @type {ClipFile} */
      const { bytes, seconds } = await request("POST", "/recording/clips");
      notify(
        `Saved the last ${fixed(seconds, 0)} s (${size(bytes)}). The clip is listed under All runs.`,
      );
      this.hub.emit("saved-clips");
    });
  }

  /** @param {Run} run */
  #item(run) {
    const remove = iconButton("trash", `Delete run ${run.name}`, () => removeRun(this.hub, run), {
      disabled: run.state === "running",
      title: "Delete",
    });
    return item(
      [
        h(
          "p",
          h("a", { href: runHref(run.id) }, run.name),
          " ",
          run.state === "finished" ? null : stateChip(run.state),
        ),
        h("p.hint", facts(run)),
        run.reason && h("p.hint", sentence(run.reason)),
      ],
      isEmpty(run)
        ? null
        : downloadLink("CSV", {
            href: `/api/runs/${encodeURIComponent(run.id)}/speeds?format=csv`,
            download: `${run.name}.csv`,
            "aria-label": `Speeds of run ${run.name} as CSV`,
          }),
      remove,
    );
  }
}

customElements.define("observer-runs", RunList);
