/** Values of parameters in words. Pure functions. */

/** @import { ParameterEntry, ParameterValue, Values } from "./parameter-store.js" */

/** @param {ParameterValue | undefined} value @returns {string} as a field shows it */
export function roundOff(value) {
  return typeof value === "number" ? String(Number(value.toPrecision(7))) : String(value ?? "");
}

/** @param {string} unit in ASCII, as declared @returns {string} as printed: "m/s²", "m/s²/√Hz" */
export function unitInWords(unit) {
  return unit.replaceAll("^2", "²").replace(/sqrt\((\w+)\)/, "√$1");
}

/**
 * @param {ParameterValue | undefined} value
 * @param {Pick<ParameterEntry, "type" | "unit" | "labels">} entry
 * @returns {string} as in "1.2 px", "on" and "Shi-Tomasi"
 */
export function valueInWords(value, { type, unit, labels }) {
  if (type === "boolean") return value ? "on" : "off";
  if (type === "choice") return labels?.[String(value)] ?? String(value);
  const words = unitInWords(value === 1 ? singular(unit) : unit);
  return words ? `${roundOff(value)} ${words}` : roundOff(value);
}

/** @param {string} unit as in "frames", "grey levels/px" and "m/s" @returns {string} for the number 1 */
function singular(unit) {
  return unit.replace(/^matches$/, "match").replace(/^(.*[a-z]{3,})s(?=$|\/)/, "$1");
}

/**
 * @param {ParameterEntry[]} schema
 * @param {Values[]} sides sets of values, of presets or of runs
 * @returns {{entry: ParameterEntry, words: string[]}[]} what differs, in declaration order
 */
export function differences(schema, sides) {
  return schema
    .filter(({ name }) => new Set(sides.map((values) => values[name])).size > 1)
    .map((entry) => ({
      entry,
      words: sides.map(({ [entry.name]: value }) =>
        value === undefined ? "–" : valueInWords(value, entry),
      ),
    }));
}

/** @param {ParameterEntry} entry @returns {string} as in "0.1 to 20 px", empty if it has none */
export function rangeInWords({ minimum, maximum, unit, type }) {
  if (type !== "number" && type !== "integer") return "";
  return `${roundOff(minimum)} to ${roundOff(maximum)}${unit ? ` ${unitInWords(unit)}` : ""}`;
}

/** @param {string} group as in "ego_motion" @returns {string} as in "Ego motion" */
export function groupTitle(group) {
  const words = group
    .replaceAll("_", " ")
    .replace(/^klt\b/, "KLT")
    .replace(/^ego /, "ego-");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

/**
 * @param {string} words with parameters by the server's names, as in "flow.residual_threshold_px"
 * @param {Pick<ParameterEntry, "name" | "title">[]} schema
 * @returns {string} with the titles of their fields, as in "Flow threshold"
 */
export function withTitles(words, schema) {
  return words.replace(/\b[a-z_]+\.[a-z_]+\b/g, (name) => {
    const entry = schema.find((each) => each.name === name);
    return entry?.title ?? name;
  });
}
