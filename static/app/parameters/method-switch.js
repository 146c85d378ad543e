/** Shows the method in force, the best one or the paper's, and switches between them. */

import { button, h, setAttribute, setText, svg } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { counted } from "../elements/words.js";
import { notify } from "../shell/notice.js";
import { MethodMemory } from "./method-memory.js";
import { MODEL, storeOf } from "./parameter-store.js";

/** @import { Preset, Values } from "./parameter-store.js" */

// Driving parameters are not part of the method.
const DRIVING = /^(guard|navigation)\./;
const METHODS = ["default", "paper"];
const METHODS_PAGE = "#methods";
const COMPARE = "M5.5 2 2 5l3.5 3V6H13V4H5.5zM10.5 8v2H3v2h7.5v2L14 11z";

class MethodSwitch extends Part {
  #memory = new MethodMemory();
  #choices = METHODS.map((name) => ({
    name,
    input: h("input", { type: "radio", name: "method", value: name }),
    mark: h("span.changed-dot", { hidden: true, "aria-hidden": "true" }),
    announcement: h("span.visually-hidden"),
  }));
  #other = h("span.other-method", { hidden: true });
  #nowName = h("span");
  #nowMark = h("span.changed-dot", { hidden: true, "aria-hidden": "true" });
  /** Replaces the switch where space is short: the current method, opening its parameters. */
  #now = button(
    [this.#nowName, this.#nowMark],
    () => document.getElementById("tab-parameters")?.click(),
    { class: "button method-now", "data-harmless": true },
  );
  #compare = h(
    "a.button.compare-methods",
    { href: METHODS_PAGE, title: "Compare both methods on the same frames" },
    svg(
      "svg",
      { viewBox: "0 0 16 16", class: "icon", "aria-hidden": "true" },
      svg("path", { d: COMPARE }),
    ),
    h("span", "Compare"),
  );
  #fields = h("fieldset.segmented", { disabled: true }, h("legend.visually-hidden", "Method"));

  get #store() {
    return storeOf(this.hub);
  }

  build() {
    for (const { name, input, mark, announcement } of this.#choices) {
      input.addEventListener("change", () => void this.#switch(name));
      this.#fields.append(h("label", input, h("span", name), mark, announcement));
    }
    this.append(this.#now, this.#fields, this.#other, this.#compare);
    this.listen("page", () => this.#markPage());
    this.#markPage();
    const store = this.#store;
    for (const type of ["values", "refused"]) store.addEventListener(type, () => this.#render());
    if (store.schema.length > 0) this.#render();
  }

  #markPage() {
    const here = location.hash.startsWith(METHODS_PAGE);
    setAttribute(this.#compare, "aria-current", here ? "page" : null);
  }

  #render() {
    const { state, presets, schema } = this.#store;
    this.#fields.disabled = schema.length === 0;
    const method = this.#currentMethod();
    const model = String(state.values[MODEL] ?? "");
    if (method) {
      this.#memory.remember(method, {
        basedOn: state.based_on,
        values: withoutDriving(state.values),
      });
    }
    let changed = 0;
    for (const { name, input, mark, announcement } of this.#choices) {
      input.checked = name === method;
      const preset = presets.find((each) => each.name === name);
      const differ = name === method && preset ? this.#differing(preset) : 0;
      changed += differ;
      mark.hidden = differ === 0;
      setText(announcement, differ > 0 ? `, ${differ} changed` : "");
      const title = `${preset?.help ?? ""}${differ > 0 ? ` ${changedWords(differ)}.` : ""}`;
      setAttribute(input.parentElement ?? input, "title", title);
    }
    this.#other.hidden = method !== null || model === "";
    setText(this.#other, model);
    setAttribute(this.#other, "title", `Current method: ${model}`);
    const name = method ?? model;
    setText(this.#nowName, name);
    this.#nowMark.hidden = changed === 0;
    const differing = changed > 0 ? `, ${changedWords(changed)}` : "";
    const words = `Current method: ${name}${differing}. Open parameters`;
    setAttribute(this.#now, "aria-label", words);
    setAttribute(this.#now, "title", words);
  }

  /**
   * Return which of the two is in force, regardless of other changed values; null if another model
   * was chosen by hand.
   */
  #currentMethod() {
    const { state, presets, defaults } = this.#store;
    const model = state.values[MODEL];
    if (defaults[MODEL] !== model) return null;
    const preset = presets.find(
      ({ name, values }) => METHODS.includes(name) && values[MODEL] === model,
    );
    return preset?.name ?? null;
  }

  /** @param {Preset} preset @returns {number} how many values of the method differ from it */
  #differing(preset) {
    const store = this.#store;
    return Object.keys(withoutDriving(store.differing(store.valuesOf(preset)))).length;
  }

  /**
   * Switch to the method as it was left, or to its preset if it was never in force.
   *
   * @param {string} name
   */
  async #switch(name) {
    const store = this.#store;
    const preset = store.findPreset(name);
    if (!preset) return this.#render();
    const before = this.#currentMethod();
    const kept = store.changed.filter((each) => !DRIVING.test(each)).length;
    const from = store.basePreset?.name ?? "";
    const left = this.#memory.recall(name);
    const base = (left && store.findPreset(left.basedOn)) ?? preset;
    const values = { ...store.valuesOf(base), ...stillValid(left?.values, store.state.values) };
    const step = await store.changeUndoably(
      withoutDriving(store.differing(values)),
      undefined,
      base.name,
    );
    if (!step) {
      // A later version may refuse values stored by an earlier one: use the preset next time.
      this.#memory.remember(name, null);
      return this.#render();
    }
    const changed = store.changed.filter((each) => !DRIVING.test(each)).length;
    if (changed === 0 && kept === 0) return;
    const as = changed > 0 ? `, as you left it: ${changedWords(changed)} from ${base.name}` : "";
    const those = `${counted(kept, "change")} to ${from}`;
    const outcome = before ? `Kept for when you switch back: ${those}.` : `Replaced: ${those}.`;
    notify(`Switched to ${name}${as}.${kept > 0 ? ` ${outcome}` : ""}`, "done", {
      words: "Undo",
      act: () => void store.revert(step),
    });
  }
}

/** @param {Values} values @returns {Values} without those of driving */
function withoutDriving(values) {
  return Object.fromEntries(Object.entries(values).filter(([name]) => !DRIVING.test(name)));
}

/**
 * @param {Values | undefined} values
 * @param {Values} present
 * @returns {Values} those that still exist with the same type
 */
function stillValid(values, present) {
  return Object.fromEntries(
    Object.entries(values ?? {}).filter(([name, value]) => typeof value === typeof present[name]),
  );
}

/** @param {number} count */
function changedWords(count) {
  return count === 1 ? "1 value differs" : `${count} values differ`;
}

customElements.define("observer-method-switch", MethodSwitch);
