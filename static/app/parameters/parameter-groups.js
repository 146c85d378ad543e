/** Fields of all parameters: the method's basic ones first, the others by group. */

import { button, h, setText } from "../elements/dom.js";
import { counted } from "../elements/words.js";
import { ParameterField } from "./parameter-field.js";
import { MODEL } from "./parameter-store.js";
import { groupTitle } from "./value-words.js";

/** @import { ParameterEntry, ParameterValue } from "./parameter-store.js" */
/** @import { ValueStore } from "./parameter-field.js" */

/**
 * @typedef {object} Section fields under one heading
 * @property {HTMLElement} host
 * @property {HTMLElement} fields
 * @property {HTMLElement} count shows how many differ
 * @property {HTMLButtonElement} reset
 */

export class ParameterGroups extends HTMLElement {
  /** @type {Map<string, ParameterField>} */
  #fields = new Map();
  #prefix;
  #term = "";
  #model = "";
  /** @type {Section | null} */
  #basic = null;
  /** By the group's name. @type {Map<string, Section>} */
  #groups = new Map();
  #othersHeading = h("h3", "All others, by group");
  #used = h("div");
  #unusedSummary = h("summary");
  #unused = h("details.unused-groups", this.#unusedSummary);
  /** Groups that were open before the search. @type {Set<HTMLDetailsElement>} */
  #open = new Set();

  /** @param {string} prefix of the controls' ids */
  constructor(prefix = "parameter") {
    super();
    this.#prefix = prefix;
  }

  /** Number of fields. */
  get count() {
    return this.#fields.size;
  }

  /**
   * @param {ParameterEntry[]} schema
   * @param {ValueStore} store
   */
  make(schema, store) {
    this.classList.add("parameter-groups");
    // Presets may be reloaded; the schema does not change while the server runs.
    if (this.#fields.size > 0) return;
    this.#basic = section(h("section.basic-parameters"), store, "basic parameters");
    this.#basic.host.append(
      h("div.section-head", h("h3", "Basic"), this.#basic.count, this.#basic.reset),
      this.#basic.fields,
    );
    for (const entry of schema) {
      if (!this.#groups.has(entry.group)) this.#groups.set(entry.group, groupOf(entry, store));
      const field = new ParameterField();
      field.build(entry, store, this.#prefix);
      this.#fields.set(entry.name, field);
    }
    this.replaceChildren(this.#basic.host, this.#othersHeading, this.#used, this.#unused);
    this.#arrange();
    // The user may have searched before the schema was loaded.
    if (this.#term) this.filter(this.#term);
  }

  /** @param {Record<string, ParameterValue>} values */
  show(values) {
    const model = String(values[MODEL] ?? "");
    if (model !== this.#model) {
      this.#model = model;
      this.#arrange();
    }
    for (const [name, field] of this.#fields) {
      const value = values[name];
      if (value !== undefined) field.show(value, model);
    }
    for (const { fields, count, reset } of this.#sections()) {
      const changed = fields.querySelectorAll("[data-changed]").length;
      setText(count, changed ? `${changed} changed` : "");
      count.hidden = changed === 0;
      reset.disabled = changed === 0;
    }
  }

  /**
   * @param {string} name
   * @param {string} sentence
   * @returns {boolean} whether there is such a field
   */
  fail(name, sentence) {
    const field = this.#fields.get(name);
    for (let at = field?.closest("details"); at; at = at.parentElement?.closest("details"))
      at.open = true;
    field?.fail(sentence);
    return field !== undefined;
  }

  /**
   * Show only fields that match a term.
   *
   * @param {string} term
   * @returns {number} how many are shown
   */
  filter(term) {
    const all = [...this.querySelectorAll("details")];
    if (term && !this.#term) this.#open = new Set(all.filter((each) => each.open));
    if (!term && this.#term) for (const each of all) each.open = this.#open.has(each);
    this.#term = term;
    let shown = 0;
    for (const field of this.#fields.values()) {
      field.hidden = !field.matchesSearch(term);
      if (!field.hidden) shown += 1;
    }
    this.#hideEmpty();
    if (term) for (const each of all) each.open = !each.hidden;
    return shown;
  }

  /** Put every field where it belongs for the method in force. */
  #arrange() {
    const focused = document.activeElement;
    /** @type {Map<HTMLElement, HTMLElement[]>} */
    const wanted = new Map();
    for (const { fields } of this.#sections()) wanted.set(fields, []);
    for (const field of this.#fields.values()) {
      const { group, basic, models } = /** @type {ParameterEntry} */ (field.entry);
      const first = basic === true && (this.#model === "" || models.includes(this.#model));
      const home = first ? this.#basic : this.#groups.get(group);
      if (home) wanted.get(home.fields)?.push(field);
    }
    for (const [host, fields] of wanted) fill(host, fields);
    const groups = [...this.#groups.values()];
    const used = groups.filter(({ fields }) => this.#isUsed(fields));
    const unused = groups.filter((group) => !used.includes(group));
    const hostOf = (/** @type {Section} */ { host }) => host;
    fill(this.#used, used.map(hostOf));
    fill(this.#unused, [this.#unusedSummary, ...unused.map(hostOf)]);
    setText(
      this.#unusedSummary,
      `${counted(unused.length, "group")} not used by the ${this.#model} method`,
    );
    this.#hideEmpty();
    // An element that was moved has lost the focus.
    if (focused instanceof HTMLElement && this.contains(focused)) focused.focus();
  }

  /** @param {HTMLElement} fields @returns {boolean} whether the method in force uses any of them */
  #isUsed(fields) {
    if (this.#model === "") return true;
    return [...fields.children].some((field) => {
      const entry = field instanceof ParameterField ? field.entry : undefined;
      return entry?.models.includes(this.#model) || entry?.cloud;
    });
  }

  /** Hide headings with nothing visible below them. */
  #hideEmpty() {
    for (const { host, fields } of this.#sections())
      host.hidden = fields.querySelector("observer-parameter:not([hidden])") === null;
    this.#unused.hidden = this.#unused.querySelector(":scope > details:not([hidden])") === null;
    const none = this.#used.querySelector(":scope > details:not([hidden])") === null;
    this.#othersHeading.hidden = none && this.#unused.hidden;
  }

  #sections() {
    return [...(this.#basic ? [this.#basic] : []), ...this.#groups.values()];
  }
}

/**
 * @param {HTMLElement} host
 * @param {ValueStore} store
 * @param {string} title as in "basic parameters"
 * @returns {Section}
 */
function section(host, store, title) {
  const fields = h("div");
  const reset = button("Reset", () => resetAll(fields, store), {
    class: "quiet reset-section",
    "aria-label": `Reset ${title}`,
    disabled: true,
  });
  return { host, fields, count: h("span.changed-badge", { hidden: true }), reset };
}

/**
 * @param {ParameterEntry} entry the first of its group
 * @param {ValueStore} store
 */
function groupOf({ group, group_help: help }, store) {
  const title = groupTitle(group);
  const made = section(h("details"), store, title);
  made.host.append(
    h("summary", h("span", title), made.count),
    h("div.section-head", h("p.hint", help), made.reset),
    made.fields,
  );
  return made;
}

/**
 * @param {HTMLElement} fields
 * @param {ValueStore} store
 */
function resetAll(fields, store) {
  /** @type {Record<string, ParameterValue>} */
  const changes = {};
  for (const field of fields.querySelectorAll("observer-parameter[data-changed]")) {
    if (!(field instanceof ParameterField) || !field.entry) continue;
    const { name, default: declared } = field.entry;
    changes[name] = store.defaults[name] ?? declared;
  }
  if (Object.keys(changes).length > 0) void store.changeUndoably(changes);
}

/**
 * Put these children first, in this order, without moving those already in place.
 *
 * @param {HTMLElement} host
 * @param {HTMLElement[]} wanted
 */
function fill(host, wanted) {
  wanted.forEach((each, at) => {
    const there = host.children[at] ?? null;
    if (each !== there) host.insertBefore(each, there);
  });
}

customElements.define("observer-parameter-groups", ParameterGroups);
