/** The page's address of one step: it carries all that the step is made of. Pure functions. */

export const STEPS = 9;
const PAPER = "paper";
// Before the name of a parameter, here and in the server's address.
const PREFIX = "p.";

/**
 * @typedef {object} StepsPlace what is looked at
 * @property {number} step from 1
 * @property {string | null} source null: the open one
 * @property {number | null} frame null: one that is worth looking at
 * @property {string} preset
 * @property {Record<string, string>} changes values that differ from the preset's, as text
 */

/**
 * @param {string} hash of the page's address, as in "#steps/4?source=simulated:lab&frame=40"
 * @returns {StepsPlace} what makes no sense is as if it were left out
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

/** @param {StepsPlace} place @returns {string} the page's address of it */
export function addressOf(place) {
  const query = readable(queryOf(place));
  return `#steps/${place.step}${query && `?${query}`}`;
}

/**
 * Return what the server has to know, the step left out.
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

/** Colons and slashes may stand in an address as they are, which people can read. */
function readable(/** @type {URLSearchParams} */ query) {
  return query.toString().replace(/%3A/g, ":").replace(/%2F/g, "/").replace(/%2C/g, ",");
}

/**
 * Return the step that a key leads to; null where it leads nowhere.
 *
 * @param {string} key
 * @param {number} step
 * @param {boolean} presents nothing can be scrolled, and a presenter's remote control turns pages
 */
export function stepByKey(key, step, presents) {
  if (key === "ArrowRight" || (presents && key === "PageDown"))
    return step < STEPS ? step + 1 : null;
  if (key === "ArrowLeft" || (presents && key === "PageUp")) return step > 1 ? step - 1 : null;
  return /^[1-9]$/.test(key) ? Number(key) : null;
}
