/** Every parameter of the method as a form, made from the server's schema. */

import { button, h, iconButton, input, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { attemptIn, notifyError } from "../shell/notice.js";
import { ParameterField } from "./parameter-field.js";
import { ParameterGroups } from "./parameter-groups.js";
import { ParameterStore } from "./parameter-store.js";
import { PresetPicker } from "./preset-picker.js";

// The groups a newcomer tries first are open at the start.
const OPEN_AT_START = ["ego_motion", "obstacles"];

class ParameterForm extends Part {
  #store = new ParameterStore();
  #presets = new PresetPicker(this.#store);
  #groups = new ParameterGroups("parameter", OPEN_AT_START);
  #search = input("search", "parameter-search", { placeholder: "Find parameters" });
  #found = h("p.hint", { role: "status" });
  #revision = h("p.hint.figure.revision");
  #undo = iconButton("undo", "Undo", () => this.#store.undo(), {
    title: "Undo (Ctrl+Z)",
    "aria-keyshortcuts": "Control+Z",
  });
  #redo = iconButton("redo", "Redo", () => this.#store.redo(), {
    title: "Redo (Ctrl+Shift+Z)",
    "aria-keyshortcuts": "Control+Shift+Z",
  });
  #resetAll = button("Reset all", () =>
    this.#store.changeUndoably(this.#store.differing(this.#store.defaults)),
  );

  build() {
    const store = this.#store;
    this.#search.addEventListener("input", () => this.#filter());
    this.addEventListener("keydown", (event) => this.#keyed(event));
    this.append(
      h("h2", "Parameters"),
      this.#presets,
      h(
        "div.row.parameter-tools",
        h("label.visually-hidden", { for: "parameter-search" }, "Find parameters"),
        this.#search,
        this.#undo,
        this.#redo,
        this.#resetAll,
      ),
      this.#revision,
      this.#found,
      this.#groups,
    );
    store.addEventListener("loaded", () => this.#groups.make(store.schema, store));
    store.addEventListener("values", () => this.#render());
    store.addEventListener("refused", (event) =>
      this.#refuse(/** @type {CustomEvent} */ (event).detail),
    );
    this.hear("status", () => {
      const { parameters_revision: revision = 0, guard_revision: guard = 0 } =
        this.hub.status ?? {};
      void store.follow(revision, guard);
    });
    this.hear("observation", () => this.#renderRevision());
    this.hear("reconnected", () => this.#load());
    void this.#load();
  }

  async #load() {
    await attemptIn(this.#found, () => this.#store.load());
  }

  #render() {
    const { state, defaults, canUndo, canRedo } = this.#store;
    this.#groups.show(state.values);
    this.#undo.disabled = !canUndo;
    this.#redo.disabled = !canRedo;
    this.#resetAll.disabled = Object.keys(this.#store.differing(defaults)).length === 0;
    this.#renderRevision();
  }

  #renderRevision() {
    const { revision, frame } = this.#store.state;
    const seen = this.hub.observation?.line.parameters_revision;
    const applied = seen !== undefined && seen >= revision;
    const since = frame === null ? "" : ` at frame ${frame}`;
    setText(this.#revision, applied ? `Applied${since}` : "Applies from the next frame");
  }

  /** @param {Record<string, string>} problems sentence by name */
  #refuse(problems) {
    for (const [name, sentence] of Object.entries(problems)) {
      if (!this.#groups.fail(name, sentence)) notifyError(sentence);
    }
  }

  #filter() {
    const term = this.#search.value.trim().toLowerCase();
    const shown = this.#groups.filter(term);
    setText(this.#found, term ? `${shown} of ${this.#groups.count} parameters` : "");
  }

  /** @param {KeyboardEvent} event */
  #keyed(event) {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    const target = event.target instanceof HTMLElement ? event.target : null;
    const field = target?.closest("observer-parameter");
    const isText =
      target instanceof HTMLInputElement && ["text", "search", "number"].includes(target.type);
    if (isText && !(field instanceof ParameterField && !field.isEdited)) return;
    const key = event.key.toLowerCase();
    const redo = key === "y" || (key === "z" && event.shiftKey);
    if (!redo && key !== "z") return;
    event.preventDefault();
    void (redo ? this.#store.redo() : this.#store.undo());
  }
}

customElements.define("observer-parameters", ParameterForm);
