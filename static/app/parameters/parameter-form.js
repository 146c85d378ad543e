/** A form of all parameters, built from the server's schema, basic ones first. */

import { button, h, iconButton, input, setText } from "../elements/dom.js";
import { declareKeys } from "../elements/keys.js";
import { Part } from "../elements/part.js";
import { counted } from "../elements/words.js";
import { notifyError } from "../shell/notice.js";
import { ParameterField } from "./parameter-field.js";
import { ParameterGroups } from "./parameter-groups.js";
import { storeOf } from "./parameter-store.js";
import { PresetPicker } from "./preset-picker.js";

declareKeys("Parameters", ["Ctrl+Z", "Undo the last change"], ["Ctrl+Y", "Redo it"]);

class ParameterForm extends Part {
  #groups = new ParameterGroups();
  #search = input("search", "parameter-search", { placeholder: "Find parameters" });
  #found = h("p.hint", { role: "status" });
  #changed = h("p.hint");
  #revision = h("p.hint.figure.revision");
  #tabBadge = h("span.changed-badge.tab-badge", { hidden: true });
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

  get #store() {
    return storeOf(this.hub);
  }

  build() {
    const store = this.#store;
    this.#search.addEventListener("input", () => this.#filter());
    this.addEventListener("keydown", (event) => this.#keyed(event));
    this.append(
      h("h2", "Parameters"),
      new PresetPicker(store),
      h(
        "div.row.parameter-tools",
        h("label.visually-hidden", { for: "parameter-search" }, "Find parameters"),
        this.#search,
        this.#undo,
        this.#redo,
        this.#resetAll,
      ),
      h("div.row.parameter-state", this.#changed, this.#revision),
      this.#found,
      this.#groups,
    );
    const tab = this.closest('[role="tabpanel"]')?.getAttribute("aria-labelledby") ?? "";
    document.getElementById(tab)?.append(this.#tabBadge);
    store.subscribe("loaded", () => this.#groups.make(store.schema, store));
    store.subscribe("values", () => this.#render());
    store.addEventListener("refused", (event) =>
      this.#refuse(/** @type {CustomEvent} */ (event).detail),
    );
    store.addEventListener("trouble", () => setText(this.#found, store.trouble));
    setText(this.#found, store.trouble);
    this.listen("observation", () => this.#renderRevision());
  }

  #render() {
    const { state, changed, basePreset, canUndo, canRedo } = this.#store;
    this.#groups.show(state.values);
    this.#undo.disabled = !canUndo;
    this.#redo.disabled = !canRedo;
    this.#resetAll.disabled = changed.length === 0;
    this.#resetAll.title = `Reset to preset ${basePreset?.name ?? ""}`;
    const differ = changed.length === 1 ? "1 value differs" : `${changed.length} values differ`;
    setText(
      this.#changed,
      changed.length === 0 ? "Unchanged from the preset" : `${differ} from the preset`,
    );
    this.#renderBadge(changed.length);
    this.#renderRevision();
  }

  /** @param {number} count of values that differ */
  #renderBadge(count) {
    this.#tabBadge.hidden = count === 0;
    if (this.#tabBadge.dataset.count === String(count)) return;
    this.#tabBadge.dataset.count = String(count);
    this.#tabBadge.replaceChildren(String(count), h("span.visually-hidden", " changed"));
  }

  #renderRevision() {
    const { revision, frame } = this.#store.state;
    const seen = this.hub.observation?.line.parameters_revision;
    const pending = seen !== undefined && seen < revision;
    const since = frame === null ? "" : `In use since frame ${frame}`;
    setText(this.#revision, pending ? "In use from the next frame" : since);
  }

  /** @param {Record<string, string>} problems sentence by name */
  #refuse(problems) {
    for (const [name, sentence] of Object.entries(problems)) {
      if (!this.#groups.fail(name, sentence)) notifyError(`Not applied: ${sentence}`);
    }
  }

  #filter() {
    const term = this.#search.value.trim().toLowerCase();
    const shown = this.#groups.filter(term);
    setText(this.#found, term ? `${shown} of ${counted(this.#groups.count, "parameter")}` : "");
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
