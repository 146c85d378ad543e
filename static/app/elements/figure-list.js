/** Figures with names and units, as a list that is made once and then refilled. */

import { h, setText } from "./dom.js";
import { GLOSSARY } from "./glossary.js";
import { fixed, half95 } from "./words.js";

/** @typedef {[term: string, text: string, help?: string]} Figure the text includes its unit */

/**
 * Server's name of a figure -> displayed name, unit, decimals, meaning; standard deviations are
 * shown as half of the 95 % interval.
 *
 * @type {Record<string, [string, string, number, string?]>}
 */
const NAMES = {
  residual_px: ["Residual", " px", 2, GLOSSARY.residual],
  threshold_px: ["Threshold", " px", 2],
  significance: ["Significance", " σ", 1, GLOSSARY.significance],
  threshold: ["Threshold", " σ", 1],
  min_significance: ["Required", " σ", 1],
  speed_mps: ["Speed", " m/s", 2],
  speed_std_mps: ["Speed, 95 % interval", " m/s", 2, GLOSSARY["95 % interval"]],
  least_speed_mps: ["Slowest detectable", " m/s", 2],
  depth_m: ["Depth", " m", 2],
  age_s: ["Track age", " s", 2],
  group_points: ["Points in group", "", 0],
  neighbours: ["Features pooled", "", 0],
  features_near: ["Features nearby", "", 0],
  nearest_feature_px: ["Nearest feature", " px", 1],
  texture_grey_per_px: ["Texture", " grey levels/px", 2],
  inliers: ["Background matches", "", 0],
  matches: ["Matches", "", 0],
  min_inliers: ["Matches required", "", 0],
};

const STANDARD_DEVIATION = /_std(_|$)/;

/**
 * @param {Record<string, number | null>} numbers
 * @returns {Figure[]} in order of importance; unknown values are marked as such
 */
export function figuresOf(numbers) {
  const order = Object.keys(NAMES);
  // Figures without a place in the order come last.
  const place = (/** @type {string} */ name) =>
    order.includes(name) ? order.indexOf(name) : order.length;
  return Object.entries(numbers)
    .sort(([a], [b]) => place(a) - place(b))
    .map(([name, value]) => {
      const [term, unit, digits, help] = NAMES[name] ?? [name.replaceAll("_", " "), "", 2];
      const known = (/** @type {number} */ number) =>
        STANDARD_DEVIATION.test(name)
          ? `± ${fixed(half95(number), digits)}${unit}`
          : `${fixed(number, digits)}${unit}`;
      const text = value === null ? "unknown" : known(value);
      return help === undefined ? [term, text] : [term, text, help];
    });
}

/** @param {Figure[]} figures */
export function figureList(figures) {
  const list = h("dl.figures");
  fillFigures(list, figures);
  return list;
}

/**
 * Show these figures in a definition list; its elements are reused while their number is the same.
 *
 * @param {HTMLDListElement} list
 * @param {Figure[]} figures
 */
export function fillFigures(list, figures) {
  if (list.childElementCount !== figures.length) {
    list.replaceChildren(
      ...figures.map(([, , title]) => h("div", { title }, h("dt"), h("dd.figure"))),
    );
  }
  figures.forEach((texts, index) => {
    [...(list.children[index]?.children ?? [])].forEach((node, i) => setText(node, texts[i] ?? ""));
  });
}
