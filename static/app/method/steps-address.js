/** The page's address of a step, which holds everything the step depends on. Pure functions. */

/** @import { Values } from "../parameters/parameter-store.js" */

/** Keys of the steps, as in the server's answers: their names are shown before the first answer. */
export const STEP_KEYS = [
  "pair",
  "features",
  "matches",
  "ego_motion",
  "transformation",
  "residual_flow",
  "stereo",
  "displacement",
  "obstacles",
];
export const STEPS = STEP_KEYS.length;
const PAPER = "paper";
// Prefix of a parameter's name, here and in the server's address.
const PREFIX = "p.";

/**
 * @typedef {object} StepsPlace what is shown
 * @property {number} step from 1
 * @property {string | null} source null: the open source
 * @property {number | null} frame null: the server chooses one worth looking at
 * @property {string} preset
 * @property {Record<string, string>} changes values that differ from the preset's, as text
 */

/**
 * @param {string} hash of the page's address, as in "#steps/4?source=simulated:lab&frame=40"
 * @returns {StepsPlace} invalid values are treated as missing
 */
export function placeOfAddress(hash) {
  const mark = `${hash}?`.indexOf("?");
  const path = hash.slice(0, mark);
  const given = new URLSearchParams(hash.slice(mark + 1));
  const step = Number(path.split("/")[1]);
  const frame = given.get("frame");
  return {
    step: Number.isInteger(step) && step >= 1 && step <= STEPS ? step : 1,
    source: given.get("source") || null,
    frame: frame !== null && /^\d{1,9}$/.test(frame) ? Number(frame) : null,
    preset: given.get("preset") || PAPER,
    changes: Object.fromEntries(
      [...given].flatMap(([name, value]) =>
        name.startsWith(PREFIX) ? [[name.slice(PREFIX.length), value]] : [],
      ),
    ),
  };
}

/** @param {StepsPlace} place @returns {string} its address on the page */
export function addressOf(place) {
  const query = readable(queryOf(place));
  return `#steps/${place.step}${query && `?${query}`}`;
}

/**
 * Return the query for the server, without the step.
 *
 * @param {StepsPlace} place
 * @param {Record<string, string>} [more]
 */
export function queryOf({ source, frame, preset, changes }, more = {}) {
  const query = new URLSearchParams();
  if (source !== null) query.set("source", source);
  if (frame !== null) query.set("frame", String(frame));
  query.set("preset", preset);
  for (const [name, value] of Object.entries(changes)) query.set(PREFIX + name, value);
  for (const [name, value] of Object.entries(more)) query.set(name, value);
  return query;
}

/**
 * Return whether two places show the same frames, computed alike, perhaps at different steps.
 *
 * @param {StepsPlace} one
 * @param {StepsPlace | null} other
 */
export function areSameFrames(one, other) {
  return other !== null && queryOf(one).toString() === queryOf(other).toString();
}

/**
 * Return the values that a place asks for; one that could not be in force stays as it was.
 *
 * @param {StepsPlace} place
 * @param {Values} preset all values of its preset
 * @returns {Values}
 */
export function valuesAt({ changes }, preset) {
  const values = { ...preset };
  for (const [name, text] of Object.entries(changes)) {
    const before = preset[name];
    if (typeof before === "boolean") values[name] = text === "true";
    else if (typeof before === "string") values[name] = text;
    else if (text.trim() !== "" && Number.isFinite(Number(text))) values[name] = Number(text);
  }
  return values;
}

/** Keep colons, slashes and commas unescaped: they are valid in a query and easier to read. */
function readable(/** @type {URLSearchParams} */ query) {
  return query.toString().replace(/%3A/g, ":").replace(/%2F/g, "/").replace(/%2C/g, ",");
}

/**
 * Return the step that a key leads to; null if it leads nowhere.
 *
 * @param {string} key
 * @param {number} step
 * @param {boolean} presents then nothing scrolls, and a remote control sends the page keys
 */
export function stepByKey(key, step, presents) {
  if (key === "ArrowRight" || (presents && key === "PageDown"))
    return step < STEPS ? step + 1 : null;
  if (key === "ArrowLeft" || (presents && key === "PageUp")) return step > 1 ? step - 1 : null;
  return /^[1-9]$/.test(key) ? Number(key) : null;
}

/**
 * Find the frame to go to instead of one that a source does not have.
 *
 * @param {string} refusal the server's sentence, which names the frames there are
 * @param {number | null} frame
 * @returns {number | null} null where it names none
 */
export function nearestFrame(refusal, frame) {
  const found = /frames are (\d+) to (\d+)/.exec(refusal);
  if (!found || frame === null) return null;
  return Math.min(Math.max(frame, Number(found[1])), Number(found[2]));
}
