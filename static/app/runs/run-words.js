/** Runs in words. Pure functions. */

import { counted, duration, when } from "../elements/words.js";

/** @import { FrameEntry, Run, Status } from "../contract" */

const UNITS = ["B", "kB", "MB", "GB", "TB"];

/** Choices of which images to record. @type {[string, string][]} */
export const RECORDING_CHOICES = [
  ["jpeg", "JPEG"],
  ["lossless", "Lossless"],
  ["none", "None"],
];

/** @param {number | null | undefined} bytes @returns {string} as in "1.4 GB" */
export function size(bytes) {
  if (bytes === null || bytes === undefined) return "–";
  let value = bytes;
  let unit = 0;
  while (value >= 999.5 && unit < UNITS.length - 1) {
    value /= 1000;
    unit += 1;
  }
  return `${unit === 0 || value >= 99.5 ? value.toFixed(0) : value.toPrecision(2)} ${UNITS[unit]}`;
}

/** Return the line that lists show below a run's name. @param {Run} run */
export function facts(run) {
  return [
    run.source_name,
    when(run.started_at),
    run.duration_s === null ? null : duration(run.duration_s),
    counted(run.frames, "frame"),
    run.segments > 1 ? counted(run.segments, "segment") : null,
    run.recording_bytes ? size(run.recording_bytes) : null,
  ]
    .filter(Boolean)
    .join(" · ");
}

/**
 * @param {string | null} id of the calibration of a run; null: nothing was chosen
 * @param {string} source of the run
 * @param {{id: string, name: string}[]} library the calibrations kept here
 */
export function calibrationInWords(id, source, library) {
  const kept = library.find((each) => each.id === id);
  if (kept) return kept.name;
  if (id === null || source.startsWith("simulated:")) return "the source's own";
  return `the source's own, or one deleted since (${id.slice(0, 12)})`;
}

/** Return whether it ended before its first frame, so that there is nothing to show. @param {Run} run */
export function isEmpty({ state, frames }) {
  // The count of an interrupted run may be behind its recording.
  return frames === 0 && (state === "finished" || state === "failed");
}

/** Return whether its recording can be played and re-run. @param {Run} run */
export function hasImages({ state, record }) {
  return state !== "running" && record !== null && record !== "none";
}

/**
 * Return the position of the frame nearest to a time.
 *
 * @param {readonly FrameEntry[]} frames of a run, at least one
 * @param {number} time seconds on the run's clock
 */
export function frameAt(frames, time) {
  let [low, high] = [0, frames.length - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    const [here, next] = [frames[middle], frames[middle + 1]];
    if (!here || !next) break;
    if (time > (here.plan.time + next.plan.time) / 2) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** Name the runs in progress, live and re-runs: lists change with them. @param {Status | null} status */
export function activeRunIds(status) {
  return [status?.run, ...(status?.reruns ?? [])].map((run) => run?.id ?? "").join(" ");
}

/** Return the page's address of a run. @param {string} id */
export function runHref(id) {
  return `#runs/${encodeURIComponent(id)}`;
}

/**
 * Return the page's address of the method step that separates moving from static, for a frame.
 *
 * @param {string} id of the run
 * @param {number} position of the frame; it is paired with the previous one
 */
export function methodHref(id, position) {
  return `#steps/6?source=run:${encodeURIComponent(id)}&frame=${Math.max(1, position)}`;
}

/** @param {string[]} ids */
export function compareHref(ids) {
  return `#runs/compare/${ids.map(encodeURIComponent).join(",")}`;
}

/**
 * @param {string} hash of the page's address
 * @returns {{view: "none" | "list" | "run" | "compare" | "methods" | "steps", ids: string[]}}
 */
export function placeOf(hash) {
  const [first, ...rest] = hash.replace(/^#/, "").split("/");
  const ids = idsIn(rest[rest[0] === "compare" ? 1 : 0]);
  if (/^steps(\?|$)/.test(first ?? "")) return { view: "steps", ids: [] };
  if (first === "methods") return { view: "methods", ids: ids.length === 2 ? ids : [] };
  if (first !== "runs") return { view: "none", ids: [] };
  const compared = rest[0] === "compare";
  if (compared) return ids.length > 1 ? { view: "compare", ids } : { view: "list", ids: [] };
  return ids.length > 0 ? { view: "run", ids: ids.slice(0, 1) } : { view: "list", ids: [] };
}

/** @param {string} [text] separated by commas */
function idsIn(text = "") {
  return text.split(",").filter(Boolean).map(decoded);
}

/** @param {string} text from the address, so it may be anything */
function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
