/** Searching runs by words and tags; choosing some to compare; deleting and restoring. */

import {
  button,
  h,
  icon,
  iconButton,
  input,
  setAttribute,
  setText,
  stateChip,
} from "../elements/dom.js";
import { KeyedList } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { counted, sentence, when } from "../elements/words.js";
import { request } from "../shell/api.js";
import { attempt, attemptIn, notify } from "../shell/notice.js";
import { compareHref, facts, activeRunIds, runHref, size } from "./run-words.js";

/** @import { History, Run } from "../contract" */

const PAGE = 50;
const ASK_AFTER_MS = 200;
// More curves than this could not be told apart.
const MAX_COMPARED = 4;

export class RunSearch extends Part {
  #words = input("search", "history-words", { placeholder: "Name, note or tag" });
  #tags = h("div.chips", { role: "group", "aria-label": "Filter by tag" });
  #chips = new KeyedList(
    this.#tags,
    (/** @type {[string, number]} */ tag) => this.#tag(...tag),
    () => this.#words,
  );
  #deleted = input("checkbox", "history-deleted");
  #found = h("p.hint", { role: "status" });
  #disk = h("p.hint");
  #compare = button("Compare", () => this.#goCompare());
  #list = h("ul.run-rows");
  #rows = new KeyedList(
    this.#list,
    (/** @type {Run} */ run) => this.#row(run),
    () => this.#words,
  );
  #more = button("Show more", () => {
    this.#limit += PAGE;
    void this.#load();
  });
  #empty = h("p.empty", { role: "status" });
  #shown = false;
  /** Only runs with all of these tags are shown. @type {Set<string>} */
  #wantedTags = new Set();
  #limit = PAGE;
  #timer = 0;
  #asked = 0;
  /** Names of the runs chosen to be compared, by id. @type {Map<string, string>} */
  #chosen = new Map();
  #undoDays = 0;
  #going = "";

  build() {
    this.append(
      h(
        "div.history-tools",
        h("label.visually-hidden", { for: "history-words" }, "Find runs"),
        this.#words,
        h("label.check", this.#deleted, "Show deleted"),
        this.#compare,
      ),
      this.#tags,
      h("div.history-counts", this.#found, this.#disk),
      this.#empty,
      this.#list,
      h("div.row", this.#more),
    );
    this.#words.addEventListener("input", () => this.#scheduleSearch());
    this.#deleted.addEventListener("change", () => void this.#load());
    this.listen("runs reconnected", () => this.#load());
    this.listen("status", () => {
      const going = activeRunIds(this.hub.status);
      if (going === this.#going) return;
      this.#going = going;
      void this.#load();
    });
    this.#renderChosen();
  }

  /** @param {boolean} shown */
  show(shown) {
    this.hidden = !shown;
    this.#shown = shown;
    if (shown) void this.#load();
  }

  #scheduleSearch() {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      this.#limit = PAGE;
      void this.#load();
    }, ASK_AFTER_MS);
  }

  async #load() {
    if (!this.#shown) return;
    const asked = ++this.#asked;
    const query = new URLSearchParams({ limit: String(this.#limit), offset: "0" });
    if (this.#words.value.trim()) query.set("text", this.#words.value.trim());
    for (const tag of this.#wantedTags) query.append("tag", tag);
    if (this.#deleted.checked) query.set("deleted", "true");
    await attemptIn(this.#found, async () => {
      /** @type {History} */
      const found = await request("GET", `/history?${query}`);
      // Ignore an answer superseded by a newer query.
      if (asked === this.#asked) this.#take(found);
    });
  }

  /** @param {History} found */
  #take({ runs, total, tags, disk, undo_days: days }) {
    this.#undoDays = days;
    const searched = this.#words.value.trim() !== "" || this.#wantedTags.size > 0;
    const there = this.#deleted.checked ? "deleted run" : "run";
    const count = searched ? `${counted(total, there)} found` : counted(total, there);
    setText(this.#found, total > 0 ? count : "");
    setText(
      this.#disk,
      `Data folder: ${size(disk.used_bytes)} used, ${size(disk.free_bytes)} free.`,
    );
    this.#empty.hidden = total > 0;
    setText(
      this.#empty,
      searched
        ? "No matching runs."
        : this.#deleted.checked
          ? `No runs deleted in the last ${counted(Math.round(days), "day")}.`
          : "No runs yet. Start a run at the top of the page to record it and list it here.",
    );
    // A tag that no run has any more can still be removed from the query.
    const known = { ...Object.fromEntries([...this.#wantedTags].map((tag) => [tag, 0])), ...tags };
    this.#chips.show(
      Object.entries(known),
      ([tag]) => tag,
      ([tag, count]) => `${tag} ${count} ${this.#wantedTags.has(tag)}`,
    );
    this.#rows.show(runs, ({ id }) => id);
    this.#more.hidden = runs.length >= total;
    this.#compare.hidden = this.#deleted.checked;
  }

  /**
   * @param {string} tag
   * @param {number} count
   */
  #tag(tag, count) {
    return button(
      [tag, " ", h("span.figure", count)],
      () => {
        if (!this.#wantedTags.delete(tag)) this.#wantedTags.add(tag);
        this.#limit = PAGE;
        void this.#load();
      },
      { class: "tag-chip", "aria-pressed": String(this.#wantedTags.has(tag)) },
    );
  }

  /** @param {Run} run */
  #row(run) {
    const choose = h("input", {
      type: "checkbox",
      "aria-label": `Select run ${run.name} to compare`,
      "data-run": run.id,
    });
    choose.checked = this.#chosen.has(run.id);
    choose.addEventListener("change", () => {
      if (choose.checked) this.#chosen.set(run.id, run.name);
      else this.#chosen.delete(run.id);
      this.#renderChosen();
    });
    return h(
      "li",
      run.deleted_at ? null : choose,
      h(
        "div.item-words",
        h(
          "p.run-line",
          run.deleted_at ? h("b", run.name) : h("a", { href: runHref(run.id) }, run.name),
          run.state === "finished" ? null : stateChip(run.state),
          run.aligned ? h("span.mark-chip", "ground truth") : null,
          run.rerun_of ? h("span.mark-chip", "re-run") : null,
          ...run.tags.map((tag) => h("span.tag-chip.plain", tag)),
        ),
        h("p.hint", facts(run)),
        run.reason ? h("p.hint", sentence(run.reason)) : null,
        run.notes ? h("p.run-notes", run.notes) : null,
        run.deleted_at
          ? h(
              "p.hint",
              `Deleted ${when(run.deleted_at)}. You can restore it for ${counted(Math.round(this.#undoDays), "day")} after that.`,
            )
          : null,
      ),
      run.deleted_at
        ? button([icon("undo"), "Restore"], () => restoreRun(this.hub, run), {
            "aria-label": `Restore run ${run.name}`,
            "data-changing": true,
          })
        : iconButton("trash", `Delete run ${run.name}`, () => this.#remove(run), {
            disabled: run.state === "running",
            title: "Delete",
            "data-changing": true,
          }),
    );
  }

  /** @param {Run} run */
  async #remove(run) {
    if (!(await removeRun(this.hub, run))) return;
    this.#chosen.delete(run.id);
    this.#renderChosen();
  }

  #renderChosen() {
    const count = this.#chosen.size;
    const possible = count >= 2 && count <= MAX_COMPARED;
    setText(this.#compare, count > 0 ? `Compare ${counted(count, "run")}` : "Compare");
    // Not disabled: its description says what is missing.
    setAttribute(this.#compare, "aria-disabled", possible ? null : "true");
    setAttribute(
      this.#compare,
      "title",
      possible ? [...this.#chosen.values()].join(", ") : `Select 2 to ${MAX_COMPARED} runs.`,
    );
  }

  #goCompare() {
    const count = this.#chosen.size;
    if (count < 2 || count > MAX_COMPARED)
      return notify(`Select 2 to ${MAX_COMPARED} runs with the checkboxes beside their names.`);
    location.hash = compareHref([...this.#chosen.keys()]);
  }
}

/**
 * Delete a run, offering to undo it.
 *
 * @param {import("../shell/hub.js").Hub} hub
 * @param {Run} run
 * @returns {Promise<boolean>} whether it was deleted
 */
export async function removeRun(hub, run) {
  if (!(await attempt(() => request("DELETE", `/runs/${encodeURIComponent(run.id)}`))))
    return false;
  notify(`Run “${run.name}” deleted.`, "done", {
    words: "Undo",
    act: () => void restoreRun(hub, run),
  });
  hub.emit("runs");
  return true;
}

/**
 * @param {import("../shell/hub.js").Hub} hub
 * @param {Run} run
 */
async function restoreRun(hub, run) {
  await attempt(async () => {
    await request("POST", `/runs/${encodeURIComponent(run.id)}/recover`);
    notify(`Run “${run.name}” restored.`);
  });
  hub.emit("runs");
}

customElements.define("observer-run-search", RunSearch);
