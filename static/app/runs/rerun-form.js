/** Re-running a run's recording with other parameters. */

import {
  details,
  field,
  fillList,
  h,
  input,
  offer,
  onSubmit,
  setAttribute,
  setText,
} from "../elements/dom.js";
import { GLOSSARY } from "../elements/glossary.js";
import { Part } from "../elements/part.js";
import { counted } from "../elements/words.js";
import { ParameterGroups } from "../parameters/parameter-groups.js";
import { request } from "../shell/api.js";
import { exclusiveRunner } from "../shell/notice.js";
import { Emitter } from "../shell/emitter.js";
import { RerunProgress } from "./rerun-progress.js";
import { compareHref, hasImages, runHref } from "./run-words.js";

/** @import { Run } from "../contract" */
/** @import { ParameterEntry, Preset, Values } from "../parameters/parameter-store.js" */

/** Values that are not in force yet. Event: `values`. */
class Draft extends Emitter {
  /** @type {Values} */
  values = {};
  /** Values that reset restores. @type {Values} */
  defaults = {};

  /** @param {Values} changes */
  async change(changes) {
    this.values = { ...this.values, ...changes };
    this.emit("values");
    return true;
  }

  /** @param {Values} changes */
  async changeUndoably(changes) {
    await this.change(changes);
  }

  /** Values that differ from the defaults. @returns {Values} */
  get differing() {
    return Object.fromEntries(
      Object.entries(this.values).filter(([name, value]) => this.defaults[name] !== value),
    );
  }
}

export class RerunForm extends Part {
  #draft = new Draft();
  #groups = new ParameterGroups("rerun");
  #name = input("text", "rerun-name", { maxlength: 100, placeholder: "Optional" });
  #preset = h("select", { id: "rerun-preset" });
  #search = input("search", "rerun-search", { placeholder: "Find parameters" });
  #differing = h("ul.plain-list");
  #differs = h("p.hint", { role: "status" });
  #start = h("button.button.primary", { type: "submit" }, "Re-run");
  #error = h("p.field-error", { role: "alert" });
  #progress = new RerunProgress();
  #done = h("p", { role: "status" });
  #form = h("form.stack", { novalidate: true });
  #without = h("p.hint");
  /** @type {ParameterEntry[]} */
  #schema = [];
  /** @type {Preset[]} */
  #presets = [];
  /** @type {Run | null} */
  #run = null;
  #do = exclusiveRunner(
    (busy) => setAttribute(this.#start, "aria-disabled", busy ? "true" : null),
    this.#error,
  );

  build() {
    this.#form.append(
      h(
        "p.hint",
        "Processes the recording again in the background, as a new run. The live source and its parameters stay as they are.",
      ),
      h("div.rerun-fields", field("Name", this.#name), field("Start from", this.#preset)),
      details(
        "Change parameters",
        h(
          "div.stack",
          h("label.visually-hidden", { for: "rerun-search" }, "Find parameters"),
          this.#search,
          this.#groups,
        ),
      ),
      this.#differs,
      this.#differing,
      this.#error,
      h("div.row", this.#start),
    );
    this.append(
      h("h3", { title: GLOSSARY["re-run"] }, "Re-run"),
      this.#without,
      this.#form,
      this.#progress,
      this.#done,
    );
    this.#progress.attach(this.hub);
    this.#progress.ended = (run) => this.#renderDone(run);
    onSubmit(this.#form, () => this.#begin());
    this.#preset.addEventListener("change", () => void this.#draft.change(this.#startingValues()));
    this.#search.addEventListener("input", () =>
      this.#groups.filter(this.#search.value.trim().toLowerCase()),
    );
    this.#draft.addEventListener("values", () => this.#render());
  }

  /** @param {Run} run */
  show(run) {
    const other = run.id !== this.#run?.id;
    this.#run = run;
    // A re-run uses the images of its original run.
    const possible = hasImages(run) || (run.rerun_of !== null && run.state !== "running");
    this.#form.hidden = !possible;
    this.#without.hidden = possible;
    setText(
      this.#without,
      run.state === "running"
        ? "Available when the run has ended."
        : "The recording has no images, so it cannot be re-run.",
    );
    if (!other) return;
    this.#name.value = "";
    setText(this.#error, "");
    setText(this.#done, "");
    // Also show a re-run that was started earlier.
    const going = this.hub.status?.reruns.find(({ rerun_of: of }) => of === run.id);
    this.#progress.watch(going ?? null);
    void this.#load();
  }

  async #load() {
    if (this.#schema.length === 0) {
      this.#schema = await request("GET", "/parameters/schema").catch(() => []);
    }
    this.#presets = await request("GET", "/presets").catch(() => []);
    this.#groups.make(this.#schema, this.#draft);
    const presets = this.#presets.map(({ name }) => [name, `preset ${name}`]);
    offer(this.#preset, [["", "this run's values"], ...presets], "");
    const declared = Object.fromEntries(this.#schema.map((entry) => [entry.name, entry.default]));
    this.#draft.values = {};
    const own = /** @type {typeof declared | undefined} */ (this.#run?.parameters);
    this.#draft.defaults = { ...declared, ...own };
    void this.#draft.change(this.#startingValues());
  }

  /** @returns {Values} */
  #startingValues() {
    const preset = this.#presets.find(({ name }) => name === this.#preset.value);
    if (!preset) return this.#draft.defaults;
    return {
      ...Object.fromEntries(this.#schema.map((entry) => [entry.name, entry.default])),
      ...preset.values,
    };
  }

  #render() {
    const { values, defaults, differing } = this.#draft;
    this.#groups.show(values);
    const lines = Object.entries(differing).map(
      ([name, value]) => `${name}: ${defaults[name]} → ${value}`,
    );
    setText(
      this.#differs,
      lines.length === 0
        ? "Same values as this run."
        : `${counted(lines.length, "value")} will differ from this run:`,
    );
    fillList(this.#differing, lines);
  }

  async #begin() {
    const run = this.#run;
    if (!run) return;
    const name = this.#name.value.trim();
    const preset = this.#preset.value;
    const begin = this.#startingValues();
    const parameters = Object.fromEntries(
      Object.entries(this.#draft.values).filter(([each, value]) => begin[each] !== value),
    );
    await this.#do(async () => {
      /** @type {Run} */
      const rerun = await request("POST", `/runs/${encodeURIComponent(run.id)}/rerun`, {
        ...(name ? { name } : {}),
        ...(preset ? { preset } : {}),
        parameters,
      });
      setText(this.#done, "");
      if (this.#run?.id === run.id) this.#progress.watch(rerun);
      this.hub.emit("runs");
    });
  }

  /** @param {Run | null} ended null: it was cancelled */
  #renderDone(ended) {
    if (!ended) return setText(this.#done, "Re-run cancelled; nothing was kept.");
    if (ended.state !== "finished" || !this.#run) return;
    this.#done.replaceChildren(
      h("a", { href: runHref(ended.id) }, ended.name),
      " is finished. ",
      h("a", { href: compareHref([this.#run.id, ended.id]) }, "Compare both runs"),
    );
  }
}

customElements.define("observer-rerun", RerunForm);
