/** Presets: choose one, save the current values as one, share and compare them. */

import { button, download, h, icon, input, offer, onSubmit, setText } from "../elements/dom.js";
import { moveFocus } from "../elements/focus.js";
import { attempt, attemptIn, askConfirmation, notify, showError } from "../shell/notice.js";
import { helpButton, openBeside } from "./help-button.js";
import { comparePresets } from "./preset-compare.js";
import { unusedName, presetFile, readPreset, refusalOf } from "./preset-files.js";

/** @import { ParameterStore } from "./parameter-store.js" */

export class PresetPicker extends HTMLElement {
  #select = h("select", { id: "preset", "aria-describedby": "preset-help" });
  #help = h("p");
  #name = input("text", "preset-name", {
    maxlength: 60,
    placeholder: "Name",
    "aria-describedby": "preset-error",
    required: true,
  });
  #error = h("p.field-error", { id: "preset-error", role: "alert" });
  #saveAs = button("Save as…", () => this.#openForm(this.#form.hidden), {
    "aria-expanded": "false",
    "aria-controls": "preset-form",
  });
  #form = h("form.row", { id: "preset-form", novalidate: true, hidden: true });
  #overwrite = button("Save", () => this.#replace(), { hidden: true });
  #delete = button("Delete preset…", () => this.#remove());
  #file = input("file", "preset-file", {
    accept: ".json,application/json",
    hidden: true,
    "aria-label": "Preset file",
  });
  #store;

  /** @param {ParameterStore} store */
  constructor(store) {
    super();
    this.#store = store;
    const [help, box] = helpButton("preset-help", "this preset", this.#help);
    const more = button("More", null, { popovertarget: "preset-more" });
    const menu = h(
      "div.pop-box.preset-more",
      { id: "preset-more", popover: true },
      button([icon("download"), "Download file"], () => this.#share(), { "data-harmless": true }),
      button([icon("upload"), "Import file…"], () => this.#file.click()),
      this.#delete,
    );
    openBeside(more, menu);
    menu.addEventListener("click", () => menu.hidePopover());
    this.#form.append(
      h("label.visually-hidden", { for: "preset-name" }, "New preset name"),
      this.#name,
      h("button.button", { type: "submit" }, "Save preset"),
    );
    onSubmit(this.#form, () => this.#save());
    this.#form.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.preventDefault();
      moveFocus(this.#form, this.#saveAs);
      this.#openForm(false);
    });
    this.#file.addEventListener("change", () => void this.#import());
    this.#select.addEventListener("change", () => void this.#choose(this.#select.value));
    this.append(
      h("div.row", h("label", { for: "preset" }, "Preset"), this.#select, help),
      h(
        "div.row.preset-actions",
        this.#overwrite,
        this.#saveAs,
        button("Compare…", () => comparePresets(store), { "data-harmless": true }),
        more,
        menu,
        this.#file,
      ),
      this.#form,
      this.#error,
      box,
    );
    store.subscribe("loaded", () => {
      offer(
        this.#select,
        store.presets.map(({ name }) => [name, name]),
      );
    });
    store.subscribe("values", () => this.#render());
  }

  #render() {
    const { basePreset: preset, changed } = this.#store;
    this.#select.value = preset?.name ?? "";
    const own = preset !== null && !preset.built_in;
    this.#overwrite.hidden = this.#delete.hidden = !own;
    this.#overwrite.disabled = changed.length === 0;
    setText(this.#help, preset?.help || "Your own preset.");
  }

  /** @param {string} name */
  async #choose(name) {
    const store = this.#store;
    const preset = store.findPreset(name);
    if (!preset) return;
    const { changed } = store;
    const before = store.basePreset?.name;
    const step = await store.choose(preset);
    if (!step) return this.#render();
    if (changed.length === 0) return;
    const values = changed.length === 1 ? "1 changed value" : `${changed.length} changed values`;
    notify(`Preset ${name} replaced ${values} of ${before}.`, "done", {
      words: "Undo",
      act: () => void store.revert(step),
    });
  }

  /** @param {boolean} open */
  #openForm(open) {
    this.#form.hidden = !open;
    this.#saveAs.setAttribute("aria-expanded", String(open));
    showError(this.#error, "");
    if (open) this.#name.focus();
  }

  async #save() {
    const name = this.#name.value.trim();
    if (!name) return showError(this.#error, "Enter a preset name.");
    const there = this.#store.findPreset(name);
    if (there && !there.built_in) {
      if (await this.#mayOverwrite(name)) await this.#saved(name, true);
      return;
    }
    await this.#saved(name, false);
  }

  async #replace() {
    const { basePreset: preset } = this.#store;
    if (preset && (await this.#mayOverwrite(preset.name))) await this.#saved(preset.name, true);
  }

  /** @param {string} name @param {boolean} over overwrite the preset of that name */
  async #saved(name, over) {
    const done = await attemptIn(this.#error, () =>
      over ? this.#store.overwritePreset(name) : this.#store.savePreset(name),
    );
    if (!done) return;
    this.#name.value = "";
    this.#openForm(false);
    notify(`Preset ${name} saved.`);
  }

  /** @param {string} name */
  #mayOverwrite(name) {
    return askConfirmation(
      `Overwrite preset ${name}?`,
      "Its values are replaced by the current ones. You cannot undo this.",
      "Overwrite preset",
    );
  }

  async #remove() {
    const name = this.#select.value;
    const sure = await askConfirmation(
      `Delete preset ${name}?`,
      "You cannot undo this. The current parameter values do not change.",
      "Delete preset",
    );
    if (sure) await attempt(() => this.#store.deletePreset(name));
  }

  /** Save the values in force as a file. */
  #share() {
    const { basePreset: preset, changed, state } = this.#store;
    const own = preset && !preset.built_in ? preset.help : "";
    const name = `${preset?.name ?? "preset"}${changed.length > 0 ? ", changed" : ""}`;
    const { text, fileName } = presetFile({ name, help: own, values: state.values });
    download(new Blob([text], { type: "application/json" }), fileName);
  }

  async #import() {
    const [file] = this.#file.files ?? [];
    if (!file) return;
    showError(this.#error, "");
    const store = this.#store;
    try {
      const preset = await readPreset(file);
      const wanted = preset.name;
      const name = unusedName(
        wanted,
        store.presets.map((each) => each.name),
      );
      await store.addPreset({ ...preset, name });
      const other = name === wanted ? "" : `, because a preset ${wanted} already exists`;
      notify(`Imported as preset ${name}${other}.`, "done", {
        words: "Use it",
        act: () => void this.#choose(name),
      });
    } catch (error) {
      showError(this.#error, refusalOf(file.name, error));
    } finally {
      // Allow choosing the same file again, once corrected.
      this.#file.value = "";
    }
  }
}

customElements.define("observer-presets", PresetPicker);
