/** Curves of speed over time, and joining several into one chart. Pure functions. */

import { fixed, half95 } from "../elements/words.js";

/** @typedef {"estimate" | "stray" | "truth" | "commanded" | "sent" | "encoder"} Kind */

/**
 * @typedef {object} Curve
 * @property {string} key unique within its chart
 * @property {Kind} kind stray: a track that matches no known body while others do
 * @property {string} label
 * @property {string} colour its name in tokens.css, such as "--track-3"
 * @property {boolean} banded whether its 95 % interval is drawn
 * @property {number[]} times seconds, rising
 * @property {(number | null)[]} speeds m/s; null breaks the curve where nothing was measured
 * @property {(number | null)[]} stds m/s, one standard deviation; null where none is known
 */

/** @typedef {(number | null | undefined)[]} Row null breaks the curve, undefined is skipped */

/**
 * Resample all curves to the union of their times: one row each, preceded by the upper and the
 * lower edge if the curve has a band.
 *
 * @param {Curve[]} curves
 * @returns {[number[], ...Row[]]}
 */
export function joined(curves) {
  const times = [...Float64Array.from(new Set(curves.flatMap((curve) => curve.times))).sort()];
  const rows = curves.flatMap((curve) => {
    const own = rowOf(curve.times, curve.speeds, times);
    if (!curve.banded) return [own];
    return [
      rowOf(curve.times, edge(curve, 1), times),
      rowOf(curve.times, edge(curve, -1), times),
      own,
    ];
  });
  return [times, ...rows];
}

/** @param {Curve} curve @param {1 | -1} side */
function edge({ speeds, stds }, side) {
  return speeds.map((speed, i) => {
    const std = stds[i];
    return speed === null || std === null || std === undefined
      ? null
      : Math.max(0, speed + side * half95(std));
  });
}

/**
 * @param {number[]} own rising
 * @param {(number | null)[]} values at these times
 * @param {number[]} times of all curves, rising, including these
 * @returns {Row}
 */
function rowOf(own, values, times) {
  /** @type {Row} */
  const row = new Array(times.length).fill(undefined);
  let at = 0;
  own.forEach((time, i) => {
    // Other curves may have samples within this gap.
    const broken = i > 0 && (values[i] === null || values[i - 1] === null);
    for (; at < times.length && Number(times[at]) < time; at += 1)
      if (broken && row[at] === undefined) row[at] = null;
    row[at] = values[i];
  });
  return row;
}

/**
 * Return the speed measured nearest to a time, never across a gap.
 *
 * @param {Pick<Curve, "times" | "speeds" | "stds">} curve
 * @param {number} time
 * @param {number} reach seconds: how far away a sample may be where the curve begins or ends
 * @returns {{speed: number, std: number | null} | null}
 */
export function speedAt({ times, speeds, stds }, time, reach) {
  const later = firstFrom(times, time);
  const near = [later - 1, later].filter((i) => typeof speeds[i] === "number");
  // Between two samples either will do; next to a gap only one within reach.
  const known = near.filter((i) => near.length === 2 || Math.abs(Number(times[i]) - time) <= reach);
  const [best] = known.sort(
    (a, b) => Math.abs(Number(times[a]) - time) - Math.abs(Number(times[b]) - time),
  );
  const speed = best === undefined ? null : speeds[best];
  if (best === undefined || typeof speed !== "number") return null;
  return { speed, std: stds[best] ?? null };
}

/**
 * Return the gaps, each from the last sample before it to the first after it.
 *
 * @param {Pick<Curve, "times" | "speeds">} curve
 * @returns {{begin: number, end: number}[]}
 */
export function gapsIn({ times, speeds }) {
  const gaps = [];
  let last = -1;
  for (const [i, speed] of speeds.entries()) {
    if (speed === null) continue;
    if (last >= 0 && i > last + 1) gaps.push({ begin: Number(times[last]), end: Number(times[i]) });
    last = i;
  }
  return gaps;
}

/** @param {{speed: number, std: number | null} | null} measured @returns {string} with its band, without unit */
export function withBand(measured) {
  if (!measured) return "–";
  const { speed, std } = measured;
  if (std === null) return fixed(speed, 2);
  return `${fixed(speed, 2)} (${fixed(Math.max(0, speed - half95(std)), 2)}–${fixed(speed + half95(std), 2)})`;
}

/** Index of the first element not below value. @param {number[]} rising @param {number} value */
export function firstFrom(rising, value) {
  let low = 0;
  let high = rising.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (Number(rising[middle]) < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** What the labels of curves that look alike begin with. @type {Partial<Record<Kind, string>>} */
const SHARED_LABELS = { truth: "Ground truth ", commanded: "Commanded " };

/**
 * Return the entries of a legend: curves that look alike share one.
 *
 * @param {Curve[]} curves
 * @param {(curve: Curve) => string} value what is read from it
 * @returns {{curve: Curve, words: string}[]} the first curve of each
 */
export function legendEntries(curves, value) {
  /** @type {{curve: Curve, words: string}[]} */
  const entries = [];
  for (const curve of curves) {
    const shared = SHARED_LABELS[curve.kind];
    const same = entries.find(
      (entry) => shared && entry.curve.kind === curve.kind && entry.curve.colour === curve.colour,
    );
    if (shared && same) same.words += `, ${curve.label.slice(shared.length)} ${value(curve)}`;
    else entries.push({ curve, words: `${curve.label} ${value(curve)}` });
  }
  return entries;
}
