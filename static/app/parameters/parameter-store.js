/** The parameters as held by the server, with changes, undo and redo. */

import { ApiError, request } from "../shell/api.js";
import { Emitter } from "../shell/emitter.js";
import { withTitles } from "./value-words.js";

/** @import * as contract from "../contract" */
/** @import { Hub } from "../shell/hub.js" */

/** @typedef {number | boolean | string} ParameterValue */
/** @typedef {Record<string, ParameterValue>} Values */
/**
 * @typedef {contract.ParameterEntry & {default: ParameterValue, minimum: number, maximum: number,
 *   step: number}} ParameterEntry only numbers have a range
 */
/** @typedef {contract.ParametersNow & {values: Values}} ParameterState */
/** @typedef {contract.Preset & {values: Values}} Preset */
/**
 * @typedef {object} PendingChange
 * @property {Values} changes
 * @property {string | undefined} basedOn the preset that the values come from, if it changes
 * @property {(taken: boolean) => void} done
 */
/**
 * @typedef {object} Step
 * @property {Values} before
 * @property {Values} after
 * @property {string} from the preset that the values came from before the step
 * @property {string} to the one after it
 */

/** Name of the parameter that chooses the method. */
export const MODEL = "ego_motion.model";

const HISTORY_LENGTH = 200;
const FALLBACK = "default";

/**
 * Events: `loaded` (schema and presets are available), `values` (values, revision or history
 * changed), `refused` (CustomEvent whose detail maps each refused field to a sentence, "" to one
 * about no field), `trouble` (they could not be read, or can be again).
 * Only one request is in flight at a time; changes made meanwhile go with the next one.
 */
export class ParameterStore extends Emitter {
  /** @type {ParameterEntry[]} */
  schema = [];
  /** @type {Preset[]} */
  presets = [];
  /** @type {ParameterState} */
  state = {
    revision: 0,
    driving_revision: 0,
    values: {},
    preset: null,
    based_on: FALLBACK,
    frame: null,
  };
  /** Values restored by "reset": those of the preset that the current ones come from. @type {Values} */
  defaults = {};
  /** Why they could not be read; empty if they were. */
  trouble = "";

  /** @type {Step[]} */
  #undoable = [];
  /** @type {Step[]} */
  #redoable = [];
  /** Settles when the newest undoable change has been answered. @type {Promise<void>} */
  #lastStep = Promise.resolve();
  /** @type {PendingChange[]} */
  #pending = [];
  #busy = false;

  /** Read everything; @throws {ApiError} */
  async load() {
    const [schema, presets, state] = await Promise.all([
      /** @type {Promise<ParameterEntry[]>} */ (request("GET", "/parameters/schema")),
      /** @type {Promise<Preset[]>} */ (request("GET", "/presets")),
      /** @type {Promise<ParameterState>} */ (request("GET", "/parameters")),
    ]);
    // The help refers to other parameters by the server's names.
    this.schema = schema.map((entry) => ({
      ...entry,
      help: withTitles(entry.help, schema),
      group_help: withTitles(entry.group_help, schema),
    }));
    this.presets = presets;
    this.emit("loaded");
    this.#take(state);
  }

  /** Read everything; errors are reported by `trouble`. */
  async reload() {
    try {
      await this.load();
      this.trouble = "";
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      this.trouble = error.message;
    }
    this.emit("trouble");
  }

  /**
   * Listen, and call the listener at once if already loaded.
   *
   * @param {"loaded" | "values"} type
   * @param {() => void} listener
   */
  subscribe(type, listener) {
    this.addEventListener(type, listener);
    if (this.schema.length > 0) listener();
  }

  /**
   * Reload the values if someone else changed them.
   *
   * @param {number} revision reported by the server
   * @param {number} drivingRevision
   */
  async follow(revision, drivingRevision) {
    const { revision: known, driving_revision: knownDriving } = this.state;
    if (revision === known && drivingRevision === knownDriving) return;
    if (this.#busy || this.schema.length === 0) return;
    this.#busy = true;
    try {
      this.#take(await request("GET", "/parameters"));
      // A preset saved on another page.
      if (this.basePreset?.name !== this.state.based_on) await this.load();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
    } finally {
      this.#busy = false;
      void this.#pump();
    }
  }

  /**
   * Request other values; all of one request take effect or none.
   *
   * @param {Values} changes
   * @param {string} [basedOn] the preset that the values come from, if it changes
   * @returns {Promise<boolean>} whether they were accepted
   */
  change(changes, basedOn) {
    return new Promise((done) => {
      this.#pending.push({ changes, basedOn, done });
      void this.#pump();
    });
  }

  /**
   * Like `change`, but undoable.
   *
   * @param {Values} changes
   * @param {Values} [before] what undo restores; the current values if omitted
   * @param {string} [basedOn] the preset that the values come from, if it changes
   * @returns {Promise<Step | null>} null if they were refused
   */
  async changeUndoably(changes, before = this.#present(Object.keys(changes)), basedOn) {
    const from = this.state.based_on;
    /** @type {Step | null} */
    let step = null;
    this.#lastStep = this.change(changes, basedOn).then((taken) => {
      if (!taken) return;
      step = { before, after: changes, from, to: this.state.based_on };
      this.#undoable.push(step);
      this.#undoable.splice(0, this.#undoable.length - HISTORY_LENGTH);
      this.#redoable = [];
      this.emit("values");
    });
    await this.#lastStep;
    return step;
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

  /** Undo one step, even if others followed it. @param {Step} step */
  async revert(step) {
    if (this.#undoable.at(-1) === step) await this.undo();
    else await this.changeUndoably(step.before, undefined, this.#known(step.from));
  }

  /** @param {string} name @returns {Preset | null} */
  findPreset(name) {
    return this.presets.find((preset) => preset.name === name) ?? null;
  }

  /** The preset that the current values come from; null before anything was read. */
  get basePreset() {
    return this.findPreset(this.state.based_on) ?? this.findPreset(FALLBACK);
  }

  /** Names of the parameters that differ from it. @returns {string[]} */
  get changed() {
    return Object.keys(this.differing(this.defaults));
  }

  /** @param {Preset | null} preset @returns {Values} all values, declared ones included */
  valuesOf(preset) {
    const declared = Object.fromEntries(this.schema.map((entry) => [entry.name, entry.default]));
    return { ...declared, ...preset?.values };
  }

  /** @param {Values} values @returns {Values} those that differ from the current ones */
  differing(values) {
    const { values: present } = this.state;
    return Object.fromEntries(Object.entries(values).filter(([name, v]) => present[name] !== v));
  }

  /** Apply a preset. @param {Preset} preset */
  async choose(preset) {
    return this.changeUndoably(this.differing(this.valuesOf(preset)), undefined, preset.name);
  }

  /** Save the current values under a new name. @param {string} name @throws {ApiError} */
  async savePreset(name) {
    await request("POST", "/presets", { name });
    await this.load();
  }

  /** Overwrite a preset with the current values. @param {string} name @throws {ApiError} */
  async overwritePreset(name) {
    await request("PUT", `/presets/${encodeURIComponent(name)}`, {});
    await this.load();
  }

  /**
   * Save the values of a file as a preset, without applying them.
   *
   * @param {{name: string, help: string, values: Record<string, unknown>}} preset
   * @throws {ApiError}
   */
  async addPreset(preset) {
    await request("POST", "/presets", preset);
    await this.load();
  }

  /** @param {string} name @throws {ApiError} */
  async deletePreset(name) {
    await request("DELETE", `/presets/${encodeURIComponent(name)}`);
    await this.load();
  }

  /** @param {string} preset its name @returns {string | undefined} undefined if it no longer exists */
  #known(preset) {
    return this.findPreset(preset) ? preset : undefined;
  }

  /** @param {string[]} names @returns {Values} */
  #present(names) {
    const { values } = this.state;
    return Object.fromEntries(names.map((name) => [name, values[name] ?? ""]));
  }

  /**
   * @param {Step[]} from
   * @param {Step[]} to
   * @param {"before" | "after"} side
   */
  async #replay(from, to, side) {
    // A change made a moment ago may still be in flight.
    await this.#lastStep;
    const step = from.pop();
    if (!step) return;
    const basedOn = this.#known(side === "before" ? step.from : step.to);
    if (await this.change(step[side], basedOn)) to.push(step);
    this.emit("values");
  }

  async #pump() {
    if (this.#busy || this.#pending.length === 0) return;
    this.#busy = true;
    const batch = this.#pending.splice(0);
    try {
      await this.#send(batch);
    } finally {
      this.#busy = false;
      void this.#pump();
    }
  }

  /** @param {PendingChange[]} batch */
  async #send(batch) {
    const changes = Object.assign({}, ...batch.map((waiting) => waiting.changes));
    const basedOn = batch.findLast((waiting) => waiting.basedOn !== undefined)?.basedOn;
    const query = basedOn === undefined ? "" : `?based_on=${encodeURIComponent(basedOn)}`;
    try {
      this.#take(await request("PATCH", `/parameters${query}`, changes));
      batch.forEach((waiting) => waiting.done(true));
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      this.#refuse(batch, error);
    }
  }

  /**
   * @param {PendingChange[]} batch
   * @param {ApiError} error
   */
  #refuse(batch, error) {
    const named = Object.keys(error.fields);
    const unaffected = batch.filter((waiting) => !named.some((name) => name in waiting.changes));
    // Changes to other fields that were merely in the same request are sent again.
    if (unaffected.length < batch.length) this.#pending.unshift(...unaffected);
    const rejected =
      unaffected.length < batch.length ? batch.filter((w) => !unaffected.includes(w)) : batch;
    const known = named.some((name) => name in this.state.values);
    const asked = rejected.flatMap((waiting) => Object.keys(waiting.changes));
    // An error about no field is shown at the only field changed, or else once for all.
    const place = new Set(asked).size === 1 ? (asked[0] ?? "") : "";
    const fields = known ? error.fields : { [place]: error.message };
    this.emit("values");
    this.dispatchEvent(new CustomEvent("refused", { detail: fields }));
    rejected.forEach((waiting) => waiting.done(false));
  }

  /** @param {ParameterState} state */
  #take(state) {
    this.state = state;
    this.defaults = this.valuesOf(this.basePreset);
    this.emit("values");
  }
}

/** @type {WeakMap<Hub, ParameterStore>} */
const stores = new WeakMap();

/**
 * Return the page's only store: a change in one part is visible and undoable in every other.
 *
 * @param {Hub} hub
 */
export function storeOf(hub) {
  const before = stores.get(hub);
  if (before) return before;
  const store = new ParameterStore();
  stores.set(hub, store);
  hub.addEventListener("status", () => {
    const { parameters_revision: revision = 0, driving_revision: driving = 0 } = hub.status ?? {};
    void store.follow(revision, driving);
  });
  hub.addEventListener("reconnected", () => void store.reload());
  void store.reload();
  return store;
}
