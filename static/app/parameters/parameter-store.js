/** The parameters as the server has them, the way to change them, and the way back. */

import { ApiError, request } from "../shell/api.js";
import { Teller } from "../shell/teller.js";

/** @import * as contract from "../contract" */

/** @typedef {number | boolean | string} ParameterValue */
/** @typedef {Record<string, ParameterValue>} Values */
/**
 * @typedef {contract.ParameterEntry & {default: ParameterValue, minimum: number, maximum: number,
 *   step: number}} ParameterEntry only numbers have a range
 */
/** @typedef {contract.ParametersNow & {values: Values}} ParameterState */
/** @typedef {contract.Preset & {values: Values}} Preset */
/** @typedef {{changes: Values, done: (taken: boolean) => void}} Waiting */

const HISTORY_LENGTH = 200;

/**
 * Events: `loaded` (schema and presets are there), `values` (values, revision or history
 * changed), `refused` (CustomEvent whose detail has the sentence of each refused field).
 * One request is under way at a time; what is changed meanwhile goes with the next one.
 */
export class ParameterStore extends Teller {
  /** @type {ParameterEntry[]} */
  schema = [];
  /** @type {Preset[]} */
  presets = [];
  /** @type {ParameterState} */
  state = { revision: 0, guard_revision: 0, values: {}, preset: null, frame: null };

  /** @type {{before: Values, after: Values}[]} */
  #undoable = [];
  /** @type {{before: Values, after: Values}[]} */
  #redoable = [];
  /** Settles when the newest undoable change has been answered. @type {Promise<void>} */
  #lastStep = Promise.resolve();
  /** @type {Waiting[]} */
  #waiting = [];
  #busy = false;

  /** Read everything; @throws {ApiError} */
  async load() {
    const [schema, presets, state] = await Promise.all([
      /** @type {Promise<ParameterEntry[]>} */ (request("GET", "/parameters/schema")),
      /** @type {Promise<Preset[]>} */ (request("GET", "/presets")),
      /** @type {Promise<ParameterState>} */ (request("GET", "/parameters")),
    ]);
    this.schema = schema;
    this.presets = presets;
    this.state = state;
    this.tell("loaded");
    this.tell("values");
  }

  /**
   * Somebody else may have changed them.
   *
   * @param {number} revision that the server tells of
   * @param {number} guardRevision
   */
  async follow(revision, guardRevision) {
    const { revision: known, guard_revision: knownGuard } = this.state;
    if (revision === known && guardRevision === knownGuard) return;
    if (this.#busy || this.schema.length === 0) return;
    this.#busy = true;
    try {
      this.#take(await request("GET", "/parameters"));
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
    } finally {
      this.#busy = false;
      void this.#pump();
    }
  }

  /**
   * Ask for other values; all of one request or none.
   *
   * @param {Values} changes
   * @returns {Promise<boolean>} whether they were taken
   */
  change(changes) {
    return new Promise((done) => {
      this.#waiting.push({ changes, done });
      void this.#pump();
    });
  }

  /**
   * `change`, and let it be undone.
   *
   * @param {Values} changes
   * @param {Values} [before] what undo goes back to; the present values if left out
   */
  async changeUndoably(changes, before = this.#present(Object.keys(changes))) {
    this.#lastStep = this.change(changes).then((taken) => {
      if (!taken) return;
      this.#undoable.push({ before, after: changes });
      this.#undoable.splice(0, this.#undoable.length - HISTORY_LENGTH);
      this.#redoable = [];
      this.tell("values");
    });
    await this.#lastStep;
  }

  get canUndo() {
    return this.#undoable.length > 0;
  }

  get canRedo() {
    return this.#redoable.length > 0;
  }

  async undo() {
    await this.#replay(this.#undoable, this.#redoable, "before");
  }

  async redo() {
    await this.#replay(this.#redoable, this.#undoable, "after");
  }

  /** Values that "reset" goes to: the preset `default` over the declared defaults. @returns {Values} */
  get defaults() {
    return this.valuesOf(this.presets.find((preset) => preset.name === "default") ?? null);
  }

  /** @param {Preset | null} preset @returns {Values} all values, declared ones included */
  valuesOf(preset) {
    const declared = Object.fromEntries(this.schema.map((entry) => [entry.name, entry.default]));
    return { ...declared, ...preset?.values };
  }

  /** @param {Values} values @returns {Values} those that differ from the present ones */
  differing(values) {
    const { values: present } = this.state;
    return Object.fromEntries(Object.entries(values).filter(([name, v]) => present[name] !== v));
  }

  /** The preset whose values these are, if any. @returns {Preset | null} */
  get matchingPreset() {
    const matching = this.presets.filter(
      (preset) => Object.keys(this.differing(this.valuesOf(preset))).length === 0,
    );
    return matching.find((preset) => preset.name === this.state.preset) ?? matching.at(-1) ?? null;
  }

  /** Keep the present values under a name. @param {string} name @throws {ApiError} */
  async savePreset(name) {
    await request("POST", "/presets", { name });
    await this.load();
  }

  /** @param {string} name @throws {ApiError} */
  async deletePreset(name) {
    await request("DELETE", `/presets/${encodeURIComponent(name)}`);
    await this.load();
  }

  /** @param {string[]} names @returns {Values} */
  #present(names) {
    const { values } = this.state;
    return Object.fromEntries(names.map((name) => [name, values[name] ?? ""]));
  }

  /**
   * @param {{before: Values, after: Values}[]} from
   * @param {{before: Values, after: Values}[]} to
   * @param {"before" | "after"} side
   */
  async #replay(from, to, side) {
    // What was changed a moment ago may still be on its way.
    await this.#lastStep;
    const step = from.pop();
    if (!step) return;
    if (await this.change(step[side])) to.push(step);
    this.tell("values");
  }

  async #pump() {
    if (this.#busy || this.#waiting.length === 0) return;
    this.#busy = true;
    const batch = this.#waiting.splice(0);
    try {
      await this.#send(batch);
    } finally {
      this.#busy = false;
      void this.#pump();
    }
  }

  /** @param {Waiting[]} batch */
  async #send(batch) {
    const changes = Object.assign({}, ...batch.map((waiting) => waiting.changes));
    try {
      this.#take(await request("PATCH", "/parameters", changes));
      batch.forEach((waiting) => waiting.done(true));
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      this.#refuse(batch, error);
    }
  }

  /**
   * @param {Waiting[]} batch
   * @param {ApiError} error
   */
  #refuse(batch, error) {
    const named = Object.keys(error.fields);
    const innocent = batch.filter((waiting) => !named.some((name) => name in waiting.changes));
    // Changes of other fields that merely travelled in the same request are sent again.
    if (innocent.length < batch.length) this.#waiting.unshift(...innocent);
    const guilty =
      innocent.length < batch.length ? batch.filter((w) => !innocent.includes(w)) : batch;
    const known = named.some((name) => name in this.state.values);
    const fields = known
      ? error.fields
      : Object.fromEntries(
          guilty.flatMap((w) => Object.keys(w.changes).map((n) => [n, error.message])),
        );
    this.tell("values");
    this.dispatchEvent(new CustomEvent("refused", { detail: fields }));
    guilty.forEach((waiting) => waiting.done(false));
  }

  /** @param {ParameterState} state */
  #take(state) {
    this.state = state;
    this.tell("values");
  }
}
