/** Ageing of the calibration in words. Pure functions. */

import { fixed, sentence } from "../elements/words.js";

/** @import { AgeingStatus, RowDriftStatus } from "../contract" */

/** What refining changes. @param {AgeingStatus} ageing */
export function refinementInWords({ vergence }) {
  return vergence.status === "drifted"
    ? "Refining sets pitch and roll between the cameras straight and corrects the vergence, as a new calibration; baseline and lenses stay."
    : "Refining sets pitch and roll between the cameras straight, as a new calibration; vergence, baseline and lenses stay.";
}

/** The skew that nobody told; empty where none is known. @param {AgeingStatus} ageing */
export function skewInWords({ exposure_skew }) {
  return exposure_skew ? sentence(exposure_skew.sentence) : "";
}

/** What is wrong with rows or vergence; empty where nothing is. @param {AgeingStatus} ageing */
export function warningInWords({ rows, vergence }) {
  const warnings = [rows.warning, vergence.status === "drifted" ? vergence.sentence : null];
  return warnings.flatMap((words) => (words ? sentence(words) : [])).join(" ");
}

/** How the distance of the rows changes. @param {RowDriftStatus} rows */
export function trendInWords(rows) {
  if (rows.trend_px_per_min === null) return "No trend is to be seen.";
  const course = rows.trend_px_per_min > 0 ? "growing" : "shrinking";
  return `It is ${course} by ${fixed(60 * Math.abs(rows.trend_px_per_min), 2)} px an hour.`;
}
