/** Fields of the parameters that a step uses. Their changes go to the page, not to the server. */

import { h } from "../elements/dom.js";
import { KeyedList } from "../elements/focus.js";
import { ParameterField } from "../parameters/parameter-field.js";
import { MODEL } from "../parameters/parameter-store.js";

/** @import { ParameterEntry, Values } from "../parameters/parameter-store.js" */

/** To its fields it is the store: a `ValueStore`. */
export class StepFields {
  #none = h("p.hint", { hidden: true }, "This step has no parameters.");
  #list = h("div.step-parameters");
  #entries = new KeyedList(this.#list, (/** @type {ParameterEntry} */ entry) => this.#field(entry));
  /** Kept when another step is shown. @type {Map<string, ParameterField>} */
  #made = new Map();
  /** Values that a field's reset restores. @type {Values} */
  defaults = {};
  /** Takes the values of a field, which may still be moving. @type {(values: Values, moving: boolean) => void} */
  changed = () => {};

  get elements() {
    return [this.#none, this.#list];
  }

  /** Take the value of a field that is still moving. @param {Values} values */
  async change(values) {
    this.changed(values, true);
  }

  /** Take the final value of a field. @param {Values} values */
  async changeUndoably(values) {
    this.changed(values, false);
  }

  /**
   * @param {string[]} names those that the step uses
   * @param {Values} values of all parameters
   * @param {ParameterEntry[]} schema what is known of them; others are not shown
   */
  show(names, values, schema) {
    const shown = names.flatMap((name) => schema.find((entry) => entry.name === name) ?? []);
    const key = (/** @type {ParameterEntry} */ { name }) => name;
    this.#entries.show(shown, key, key);
    this.#none.hidden = shown.length > 0;
    const model = String(values[MODEL]);
    for (const { name } of shown) {
      const value = values[name];
      if (value !== undefined) this.#made.get(name)?.show(value, model);
    }
  }

  /** @param {string} name */
  shows(name) {
    return this.#made.get(name)?.isConnected === true;
  }

  /** Say at a field why its value was refused. @param {string} name @param {string} message */
  fail(name, message) {
    this.#made.get(name)?.fail(message);
  }

  /** @param {ParameterEntry} entry */
  #field(entry) {
    const made = this.#made.get(entry.name);
    if (made) return made;
    const field = new ParameterField();
    field.build(entry, this, "step");
    this.#made.set(entry.name, field);
    return field;
  }
}
