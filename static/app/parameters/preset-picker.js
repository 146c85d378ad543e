/** Presets: choose one, keep the present values as one. */

import { h, iconButton, onSubmit, setText, textInput } from "../elements/dom.js";
import { attempt, attemptIn, confirmed, notify } from "../shell/notice.js";

/** @import { ParameterStore } from "./parameter-store.js" */

export class PresetPicker extends HTMLElement {
  #select = h("select", { id: "preset", "aria-describedby": "preset-help" });
  #help = h("p.hint", { id: "preset-help" });
  #name = textInput("preset-name", {
    maxlength: 60,
    "aria-describedby": "preset-error",
    required: true,
  });
  #error = h("p.field-error", { id: "preset-error", role: "alert" });
  #delete = iconButton("trash", "Delete this preset", null);

  /** @param {ParameterStore} store */
  build(store) {
    const save = h(
      "form.row",
      { novalidate: true },
      h("label.visually-hidden", { for: "preset-name" }, "Name of the new preset"),
      this.#name,
      h("button.button", { type: "submit" }, "Save preset"),
    );
    this.#name.placeholder = "New preset's name";
    onSubmit(save, () => this.#save(store));
    this.#select.addEventListener("change", () => {
      const preset = store.presets.find((p) => p.name === this.#select.value);
      if (preset) void store.changeUndoably(store.differing(store.valuesOf(preset)));
    });
    this.#delete.addEventListener("click", () => void this.#remove(store));
    this.append(
      h("div.row", h("label", { for: "preset" }, "Preset"), this.#select, this.#delete),
      this.#help,
      save,
      this.#error,
    );
    store.addEventListener("loaded", () => this.#fill(store));
    store.addEventListener("values", () => this.#render(store));
  }

  /** @param {ParameterStore} store */
  #fill(store) {
    this.#select.replaceChildren(
      h("option", { value: "", disabled: true }, "your own values"),
      ...store.presets.map((preset) => h("option", { value: preset.name }, preset.name)),
    );
  }

  /** @param {ParameterStore} store */
  #render(store) {
    const preset = store.matchingPreset;
    this.#select.value = preset?.name ?? "";
    this.#delete.hidden = preset === null || preset.built_in;
    setText(this.#help, preset?.help || "Differs from every preset.");
  }

  /** @param {ParameterStore} store */
  async #save(store) {
    const name = this.#name.value.trim();
    setText(this.#error, name ? "" : "Give the preset a name first.");
    if (!name) return;
    await attemptIn(this.#error, async () => {
      await store.savePreset(name);
      this.#name.value = "";
      notify(`Preset ${name} saved.`);
    });
  }

  /** @param {ParameterStore} store */
  async #remove(store) {
    const name = this.#select.value;
    if (
      !(await confirmed(
        `Delete preset ${name}?`,
        "The values in force stay as they are.",
        "Delete preset",
      ))
    )
      return;
    await attempt(() => store.deletePreset(name));
  }
}

customElements.define("observer-presets", PresetPicker);
