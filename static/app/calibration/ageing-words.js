/** Ageing of the calibration in words. Pure functions. */

import { fixed, sentence } from "../elements/words.js";

/** @import { AgeingStatus, RowDriftStatus } from "../contract" */

/** What refining the calibration changes. @param {AgeingStatus} ageing */
export function refinementInWords({ vergence }) {
  return vergence.status === "drifted"
    ? "Refining corrects the pitch, roll and vergence between the cameras and saves a new calibration. Baseline and lens parameters stay the same."
    : "Refining corrects the pitch and roll between the cameras and saves a new calibration. Vergence, baseline and lens parameters stay the same.";
}

/** The exposure skew, if not reported by the source; empty where none is known. @param {AgeingStatus} ageing */
export function skewInWords({ exposure_skew }) {
  return exposure_skew ? sentence(exposure_skew.sentence) : "";
}

/** What is wrong with rows or vergence; empty where nothing is. @param {AgeingStatus} ageing */
export function warningInWords({ rows, vergence }) {
  const warnings = [rows.warning, vergence.status === "drifted" ? vergence.sentence : null];
  return warnings.flatMap((words) => (words ? sentence(words) : [])).join(" ");
}

/** The trend of the row error. @param {RowDriftStatus} rows */
export function trendInWords(rows) {
  if (rows.trend_px_per_min === null) return "No trend.";
  const course = rows.trend_px_per_min > 0 ? "Growing" : "Shrinking";
  return `${course} by ${fixed(60 * Math.abs(rows.trend_px_per_min), 2)} px per hour.`;
}
