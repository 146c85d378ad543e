/** Fields of all parameters, by group; made once from the server's declaration. */

import { h, setText } from "../elements/dom.js";
import { ParameterField } from "./parameter-field.js";

/** @import { ParameterEntry, ParameterValue } from "./parameter-store.js" */

const MODEL = "ego_motion.model";

export class ParameterGroups extends HTMLElement {
  /** @type {Map<string, ParameterField>} */
  #fields = new Map();
  #prefix;
  #openAtStart;
  #term = "";

  /**
   * @param {string} prefix of the controls' ids
   * @param {string[]} openAtStart groups
   */
  constructor(prefix = "parameter", openAtStart = []) {
    super();
    this.#prefix = prefix;
    this.#openAtStart = openAtStart;
  }

  /** Number of fields. */
  get count() {
    return this.#fields.size;
  }

  /**
   * @param {ParameterEntry[]} schema
   * @param {import("./parameter-field.js").ValueStore} store
   */
  make(schema, store) {
    this.classList.add("parameter-groups");
    // Presets may come anew; the declaration does not change while the server runs.
    if (this.#fields.size > 0) return;
    /** @type {Map<string, HTMLDetailsElement>} */
    const groups = new Map();
    for (const entry of schema) {
      let group = groups.get(entry.group);
      if (!group) {
        group = h(
          "details",
          { open: this.#openAtStart.includes(entry.group) },
          h("summary", h("span", titleOf(entry.group)), h("span.count")),
          h("p.hint", entry.group_help),
        );
        groups.set(entry.group, group);
      }
      const field = new ParameterField();
      field.build(entry, store, this.#prefix);
      this.#fields.set(entry.name, field);
      group.append(field);
    }
    this.replaceChildren(...groups.values());
    // Somebody may have asked for something before the declaration was here.
    if (this.#term) this.filter(this.#term);
  }

  /** @param {Record<string, ParameterValue>} values */
  show(values) {
    const model = String(values[MODEL] ?? "");
    for (const [name, field] of this.#fields) {
      const value = values[name];
      if (value !== undefined) field.show(value, model);
    }
    for (const group of this.querySelectorAll("details")) {
      const changed = group.querySelectorAll("[data-changed]").length;
      const idle = group.querySelector("observer-parameter:not([data-idle])") === null;
      group.toggleAttribute("data-idle", idle);
      const notes = [
        idle ? `not used by the ${model} model` : "",
        changed ? `${changed} changed` : "",
      ];
      const count = group.querySelector(".count");
      if (count) setText(count, notes.filter(Boolean).join(", "));
    }
  }

  /**
   * @param {string} name
   * @param {string} sentence
   * @returns {boolean} whether there is such a field
   */
  fail(name, sentence) {
    const field = this.#fields.get(name);
    field?.closest("details")?.setAttribute("open", "");
    field?.fail(sentence);
    return field !== undefined;
  }

  /**
   * Show only what is about a term.
   *
   * @param {string} term
   * @returns {number} how many are shown
   */
  filter(term) {
    this.#term = term;
    let shown = 0;
    for (const group of this.querySelectorAll("details")) {
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
    return shown;
  }
}

/** @param {string} group as in "ego_motion" */
function titleOf(group) {
  const words = group.replaceAll("_", " ").replace(/^klt\b/, "KLT");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

customElements.define("observer-parameter-groups", ParameterGroups);
