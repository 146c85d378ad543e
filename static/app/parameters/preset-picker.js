/** Presets: choose one, keep the present values as one. */

import { h, iconButton, input, offer, onSubmit, setText } from "../elements/dom.js";
import { attempt, attemptIn, confirmed, notify, refuse } from "../shell/notice.js";

/** @import { ParameterStore } from "./parameter-store.js" */

export class PresetPicker extends HTMLElement {
  #select = h("select", { id: "preset", "aria-describedby": "preset-help" });
  #help = h("p.hint", { id: "preset-help" });
  #name = input("text", "preset-name", {
    maxlength: 60,
    placeholder: "New preset name",
    "aria-describedby": "preset-error",
    required: true,
  });
  #error = h("p.field-error", { id: "preset-error", role: "alert" });
  #delete = iconButton("trash", "Delete preset", () => this.#remove());
  #store;

  /** @param {ParameterStore} store */
  constructor(store) {
    super();
    this.#store = store;
    const save = h(
      "form.row",
      { novalidate: true },
      h("label.visually-hidden", { for: "preset-name" }, "New preset name"),
      this.#name,
      h("button.button", { type: "submit" }, "Save preset"),
    );
    onSubmit(save, () => this.#save());
    this.#select.addEventListener("change", () => {
      const preset = store.presets.find((p) => p.name === this.#select.value);
      if (preset) void store.changeUndoably(store.differing(store.valuesOf(preset)));
    });
    this.append(
      h("div.row", h("label", { for: "preset" }, "Preset"), this.#select, this.#delete),
      this.#help,
      save,
      this.#error,
    );
    store.addEventListener("loaded", () => {
      const names = store.presets.map(({ name }) => [name, name]);
      offer(this.#select, [["", "custom values"], ...names]);
      // Nothing to be chosen: it says that no preset has these values.
      this.#select.options[0]?.toggleAttribute("disabled", true);
    });
    store.addEventListener("values", () => this.#render());
  }

  #render() {
    const preset = this.#store.matchingPreset;
    this.#select.value = preset?.name ?? "";
    this.#delete.hidden = preset === null || preset.built_in;
    setText(this.#help, preset?.help || "The current values match no preset.");
  }

  async #save() {
    const name = this.#name.value.trim();
    if (!name) return refuse(this.#error, "Enter a preset name.");
    await attemptIn(this.#error, async () => {
      await this.#store.savePreset(name);
      this.#name.value = "";
      notify(`Preset ${name} saved.`);
    });
  }

  async #remove() {
    const name = this.#select.value;
    const sure = await confirmed(
      `Delete preset ${name}?`,
      "You cannot undo this. The current parameter values stay in force.",
      "Delete preset",
    );
    if (sure) await attempt(() => this.#store.deletePreset(name));
  }
}

customElements.define("observer-presets", PresetPicker);
