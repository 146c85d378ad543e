/** Every parameter of the method as a form, made from the server's schema. */

import { ApiError } from "./api.js";
import { h, icon, setText } from "./dom.js";
import { notifyError } from "./notice.js";
import { ParameterField } from "./parameter-field.js";
import { ParameterStore } from "./parameter-store.js";
import { Part } from "./part.js";
import { PresetPicker } from "./preset-picker.js";

// The groups a newcomer tries first are open at the start.
const OPEN_AT_START = ["ego_motion", "obstacles"];
const MODEL = "ego_motion.model";

class ParameterForm extends Part {
  #store = new ParameterStore();
  /** @type {Map<string, ParameterField>} */
  #fields = new Map();
  #presets = new PresetPicker();
  #groups = h("div", { class: "parameter-groups" });
  #search = h("input", { type: "search", id: "parameter-search", placeholder: "Find a parameter", autocomplete: "off" });
  #found = h("p", { class: "hint", role: "status" });
  #revision = h("p", { class: "hint figure revision" });
  #undo = h("button", { type: "button", class: "button icon-button", "aria-label": "Undo", title: "Undo (Ctrl+Z)", "aria-keyshortcuts": "Control+Z" }, icon("undo"));
  #redo = h("button", { type: "button", class: "button icon-button", "aria-label": "Redo", title: "Redo (Ctrl+Shift+Z)", "aria-keyshortcuts": "Control+Shift+Z" }, icon("redo"));
  #resetAll = h("button", { type: "button", class: "button" }, "Reset all");

  build() {
    const store = this.#store;
    this.#presets.build(store);
    this.#undo.addEventListener("click", () => void store.undo());
    this.#redo.addEventListener("click", () => void store.redo());
    this.#resetAll.addEventListener("click", () => void store.changeUndoably(store.differing(store.defaults)));
    this.#search.addEventListener("input", () => this.#filter());
    this.addEventListener("keydown", (event) => this.#keyed(event));
    this.append(
      h("h2", {}, "Parameters"),
      this.#presets,
      h("div", { class: "row parameter-tools" },
        h("label", { for: "parameter-search", class: "visually-hidden" }, "Find a parameter"),
        this.#search, this.#undo, this.#redo, this.#resetAll),
      this.#revision,
      this.#found,
      this.#groups,
    );
    store.addEventListener("loaded", () => this.#make());
    store.addEventListener("values", () => this.#render());
    store.addEventListener("refused", (event) => this.#refuse(/** @type {CustomEvent} */ (event).detail));
    this.hear("status", () => void store.follow(this.hub.status?.parameters_revision ?? 0));
    this.hear("observation", () => this.#renderRevision());
    this.hear("reconnected", () => void this.#load());
    void this.#load();
  }

  async #load() {
    try {
      await this.#store.load();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      setText(this.#found, error.message);
    }
  }

  #make() {
    // Presets may come anew; the declaration does not change while the server runs.
    if (this.#fields.size > 0) return;
    /** @type {Map<string, HTMLDetailsElement>} */
    const groups = new Map();
    for (const entry of this.#store.schema) {
      let group = groups.get(entry.group);
      if (!group) {
        group = h("details", { open: OPEN_AT_START.includes(entry.group) },
          h("summary", {}, h("span", {}, titleOf(entry.group)), h("span", { class: "count" })),
          h("p", { class: "hint" }, entry.group_help));
        groups.set(entry.group, group);
      }
      const field = new ParameterField();
      field.build(entry, this.#store);
      this.#fields.set(entry.name, field);
      group.append(field);
    }
    this.#groups.replaceChildren(...groups.values());
  }

  #render() {
    const { state, defaults, canUndo, canRedo } = this.#store;
    const model = String(state.values[MODEL] ?? "");
    for (const [name, field] of this.#fields) {
      const value = state.values[name];
      if (value !== undefined) field.show(value, model);
    }
    for (const group of this.#groups.querySelectorAll("details")) {
      const changed = group.querySelectorAll("[data-changed]").length;
      const idle = group.querySelector("observer-parameter:not([data-idle])") === null;
      group.toggleAttribute("data-idle", idle);
      const notes = [idle ? `not used by ${model}` : "", changed ? `${changed} changed` : ""];
      const count = group.querySelector(".count");
      if (count) setText(count, notes.filter(Boolean).join(", "));
    }
    this.#undo.disabled = !canUndo;
    this.#redo.disabled = !canRedo;
    this.#resetAll.disabled = Object.keys(this.#store.differing(defaults)).length === 0;
    this.#renderRevision();
  }

  #renderRevision() {
    const { revision, frame } = this.#store.state;
    const seen = this.hub.observation?.line.parameters_revision;
    const force = seen === undefined ? "" : seen >= revision ? ", in force" : ", waiting for the next frame";
    const since = frame === null ? "" : `, acts from frame ${frame}`;
    setText(this.#revision, `Revision ${revision}${since}${force}`);
  }

  /** @param {Record<string, string>} problems sentence by name */
  #refuse(problems) {
    for (const [name, sentence] of Object.entries(problems)) {
      const field = this.#fields.get(name);
      if (field) {
        field.closest("details")?.setAttribute("open", "");
        field.fail(sentence);
      } else {
        notifyError(sentence);
      }
    }
  }

  #filter() {
    const term = this.#search.value.trim().toLowerCase();
    let shown = 0;
    for (const group of this.#groups.querySelectorAll("details")) {
      let here = 0;
      for (const field of group.querySelectorAll("observer-parameter")) {
        if (!(field instanceof ParameterField)) continue;
        field.hidden = !field.isAbout(term);
        if (!field.hidden) here += 1;
      }
      group.hidden = here === 0;
      if (term && here > 0) group.open = true;
      shown += here;
    }
    setText(this.#found, term ? `${shown} of ${this.#fields.size} parameters` : "");
  }

  /** @param {KeyboardEvent} event */
  #keyed(event) {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    const target = event.target instanceof HTMLElement ? event.target : null;
    const field = target?.closest("observer-parameter");
    const isText = target instanceof HTMLInputElement && ["text", "search", "number"].includes(target.type);
    if (isText && !(field instanceof ParameterField && !field.isEdited)) return;
    const key = event.key.toLowerCase();
    const redo = key === "y" || (key === "z" && event.shiftKey);
    if (!redo && key !== "z") return;
    event.preventDefault();
    void (redo ? this.#store.redo() : this.#store.undo());
  }
}

/** @param {string} group as in "ego_motion" */
function titleOf(group) {
  const words = group.replaceAll("_", " ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

customElements.define("observer-parameters", ParameterForm);
