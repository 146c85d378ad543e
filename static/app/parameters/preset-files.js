/** Presets as files for sharing: JSON that the server accepts as is. Pure except `readPreset`. */

import { LONGEST_NAME, LONGEST_PRESET_HELP, PRESET_FORMAT } from "../elements/facts.js";
import { ApiError } from "../shell/api.js";

/** @import { Values } from "./parameter-store.js" */
/** @typedef {{name: string, help: string, values: Record<string, unknown>}} SharedPreset */

const MAX_BYTES = 200_000;

/** The file is not a preset; the message is one sentence. */
export class PresetFileError extends Error {}

/**
 * @param {{name: string, help: string, values: Values}} preset
 * @returns {{text: string, fileName: string}}
 */
export function presetFile({ name, help, values }) {
  const text = `${JSON.stringify({ format: PRESET_FORMAT, name, help, values }, null, 2)}\n`;
  const plain = name.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "preset";
  return { text, fileName: `${plain}.preset.json` };
}

/** @param {File} file @throws {PresetFileError} */
export async function readPreset(file) {
  if (file.size > MAX_BYTES) throw new PresetFileError(`${file.name} is too large for a preset.`);
  return parsePreset(await file.text(), file.name);
}

/**
 * @param {string} text
 * @param {string} fileName
 * @returns {SharedPreset} its values are not validated
 * @throws {PresetFileError}
 */
export function parsePreset(text, fileName) {
  const content = parsed(text, fileName);
  if (content?.format !== PRESET_FORMAT) {
    throw new PresetFileError(
      `${fileName} is not a preset: its "format" must be "${PRESET_FORMAT}", as in files saved here.`,
    );
  }
  const { name, help, values } = content;
  if (typeof values !== "object" || values === null || Array.isArray(values)) {
    throw new PresetFileError(
      `${fileName} has no "values": they must be parameters by name, as in {"flow.window_px": 15}.`,
    );
  }
  return {
    name:
      fileSafeName(name) || fileSafeName(fileName.replace(/(\.preset)?\.json$/i, "")) || "imported",
    help: typeof help === "string" ? help.slice(0, LONGEST_PRESET_HELP) : "",
    values,
  };
}

/**
 * @param {string} wanted
 * @param {string[]} taken
 * @returns {string} the name, with a number appended if it is taken
 */
export function unusedName(wanted, taken) {
  let name = wanted;
  for (let number = 2; taken.includes(name); number += 1) {
    const behind = ` ${number}`;
    name = `${wanted.slice(0, LONGEST_NAME - behind.length)}${behind}`;
  }
  return name;
}

/**
 * Say in one sentence why a file was refused.
 *
 * @param {string} fileName
 * @param {unknown} error
 */
export function refusalOf(fileName, error) {
  if (error instanceof PresetFileError) return error.message;
  if (!(error instanceof ApiError)) throw error;
  const [first, ...others] = Object.entries(error.fields);
  const why = first ? first.filter(Boolean).join(": ").replace(/\.$/, "") : error.message;
  const more = others.length > 0 ? `, and ${others.length} more` : "";
  return `${fileName} was not imported: ${why}${more}${/\.$/.test(why) && !more ? "" : "."}`;
}

/**
 * @param {string} text
 * @param {string} fileName
 */
function parsed(text, fileName) {
  try {
    return JSON.parse(text);
  } catch {
    throw new PresetFileError(`${fileName} is not a preset: it is not JSON.`);
  }
}

/** @param {unknown} name @returns {string} on a single line, short enough */
function fileSafeName(name) {
  if (typeof name !== "string") return "";
  return name
    .replace(/[\x00-\x1f\x7f]+/g, " ")
    .trim()
    .slice(0, LONGEST_NAME);
}
