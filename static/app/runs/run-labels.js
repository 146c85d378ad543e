/** A run's name, tags and notes, by which it can be searched; saved as they change. */

import { button, field, h, icon, input, onSubmit, setText } from "../elements/dom.js";
import { KeyedList } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { attemptIn } from "../shell/notice.js";

/** @import { History, Run } from "../contract" */

export class RunLabels extends Part {
  /** Called with the run as saved. @type {(run: Run) => void} */
  changed = () => {};

  #name = input("text", "run-label-name", { maxlength: 100 });
  #notes = h("textarea", { id: "run-label-notes", rows: 4, maxlength: 20000 });
  #list = h("ul.tag-list", { "aria-label": "Tags" });
  #tags = new KeyedList(
    this.#list,
    (/** @type {string} */ tag) => this.#tag(tag),
    () => this.#add,
  );
  #add = input("text", "run-label-tag", {
    list: "run-label-tags",
    maxlength: 300,
    placeholder: "Add tag",
  });
  #known = h("datalist", { id: "run-label-tags" });
  #state = h("p.hint", { role: "status" });
  #error = h("p.field-error", { role: "alert" });
  /** @type {Run | null} */
  #run = null;
  /** Settles when the newest change has been saved or refused. @type {Promise<unknown>} */
  #lastChange = Promise.resolve();

  build() {
    const form = h(
      "form.row.tag-form",
      h("label.visually-hidden", { for: "run-label-tag" }, "Add tag"),
      this.#add,
      this.#known,
      h("button.button", { type: "submit" }, "Add"),
    );
    this.append(
      h("h3", "Name, tags and notes"),
      field("Name", this.#name),
      h("div.named-part", h("span.field-name", "Tags"), this.#list, form),
      field("Notes", this.#notes),
      this.#error,
      this.#state,
    );
    this.#name.addEventListener("change", () => {
      const name = this.#name.value.trim();
      if (name) void this.#keep(() => ({ name }));
      else if (this.#run) this.#name.value = this.#run.name;
    });
    this.#notes.addEventListener("change", () => {
      const notes = this.#notes.value;
      void this.#keep(() => ({ notes }));
    });
    onSubmit(form, () => this.#addTags());
    this.#add.addEventListener("focus", () => void this.#suggest());
  }

  /** @param {Run} run */
  show(run) {
    const other = run.id !== this.#run?.id;
    this.#run = run;
    if (other) {
      setText(this.#state, "");
      setText(this.#error, "");
      this.#add.value = "";
    }
    // Do not overwrite what is being typed with the saved text.
    for (const [input, text] of /** @type {const} */ ([
      [this.#name, run.name],
      [this.#notes, run.notes],
    ])) {
      if (other || document.activeElement !== input) input.value = text;
    }
    this.#tags.show(run.tags, (tag) => tag);
  }

  /** @param {string} tag */
  #tag(tag) {
    const remove = button(
      icon("close"),
      () => this.#keep(({ tags }) => ({ tags: tags.filter((each) => each !== tag) })),
      { class: "quiet", "aria-label": `Remove tag ${tag}` },
    );
    return h("li.tag-chip.plain", tag, remove);
  }

  /** Add one tag or several separated by commas. */
  async #addTags() {
    const added = this.#add.value
      .split(",")
      .map((tag) => tag.trim())
      .filter(Boolean);
    if (added.length === 0) return;
    const taken = await this.#keep(({ tags }) => ({ tags: [...new Set([...tags, ...added])] }));
    if (taken) this.#add.value = "";
  }

  async #suggest() {
    /** @type {History | null} */
    const found = await request("GET", "/history?limit=1&offset=0").catch(() => null);
    this.#known.replaceChildren(
      ...Object.keys(found?.tags ?? {}).map((tag) => h("option", { value: tag })),
    );
  }

  /**
   * Save a change once those before it have been answered: all tags are sent together, so a change
   * based on older ones would undo theirs.
   *
   * @param {(run: Run) => {name?: string, tags?: string[], notes?: string}} change of the newest run
   * @returns {Promise<boolean>} whether it was saved
   */
  async #keep(change) {
    const run = this.#run;
    if (!run) return false;
    const done = this.#lastChange.then(() =>
      this.#save(run.id, change(this.#run?.id === run.id ? this.#run : run)),
    );
    this.#lastChange = done.catch(() => false);
    return done;
  }

  /** @param {string} id of the run @param {object} change */
  async #save(id, change) {
    setText(this.#state, "Saving…");
    const done = await attemptIn(this.#error, async () => {
      /** @type {Run} */
      const kept = await request("PATCH", `/runs/${encodeURIComponent(id)}`, change);
      if (this.#run?.id === kept.id) {
        this.show(kept);
        this.changed(kept);
      }
      this.hub.emit("runs");
    });
    setText(this.#state, done ? "Saved." : "");
    return done;
  }
}

customElements.define("observer-run-labels", RunLabels);
