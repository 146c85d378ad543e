/** The comparison of two methods in words and numbers. Pure functions. */

import { counted, durationInWords, fixed } from "../elements/words.js";

/** @import { FrameEntry, Run, RunFrames } from "../contract" */
/** @import { Figure } from "../elements/figure-list.js" */

/**
 * @typedef {object} Method one side of the split screen
 * @property {Run} run
 * @property {string} name of the preset, or of the run
 * @property {RunFrames} found
 */

// The first frames take longer than the others.
const JUDGED_AFTER_S = 3;
const ROUNDED_S = 5;
const FALSE =
  "Reported as moving although nothing moves there; summed over the frames up to this one";
const FOUND = "Moving obstacles in sight that were found; summed over the frames up to this one";
const ERROR = "Root mean square of reported minus true velocity, over the frames up to this one";
const SEEN = "Reported obstacles, summed over the frames up to this one";
const TIME = "Median processing time of a frame, measured at low priority during the comparison";

/**
 * @param {Run[]} runs
 * @returns {string[]} a short name for each: its preset if that is unique, else the run's name
 */
export function methodNames(runs) {
  const presets = runs.map(({ preset }) => preset ?? "custom values");
  return new Set(presets).size === runs.length ? presets : runs.map(({ name }) => name);
}

/**
 * Return whether all are of the same frames.
 *
 * @param {RunFrames[]} found
 */
export function sameFrames([first, ...others]) {
  return others.every(
    ({ frames, width, height }) =>
      first !== undefined &&
      width === first.width &&
      height === first.height &&
      frames.length === first.frames.length &&
      frames.every(
        ({ frame, time }, at) =>
          frame === first.frames[at]?.frame && time === first.frames[at]?.time,
      ),
  );
}

/**
 * Return the figures of one method up to a frame.
 *
 * @param {RunFrames} found
 * @param {number} position
 * @returns {Figure[]}
 */
export function figuresAt({ frames, observed_ms: ms }, position) {
  const counts = frames[position]?.counts;
  /** @type {Figure} */
  const time = ["Time per frame", ms === null ? "–" : `${fixed(ms, 0)} ms`, TIME];
  if (!counts) {
    const seen = frames.slice(0, position + 1).map(({ obstacles }) => obstacles.length);
    return [
      ["Obstacles now", String(seen.at(-1) ?? 0)],
      ["Obstacles so far", String(sum(seen)), SEEN],
      time,
    ];
  }
  const { false: wrong, found, missed, velocity_rmse_mps: error } = counts;
  return [
    ["False obstacles", String(wrong), FALSE],
    ["Found", `${found} of ${found + missed}`, FOUND],
    ["Velocity error", error === null ? "–" : `${fixed(error, 2)} m/s`, ERROR],
    time,
  ];
}

/**
 * Return the result of the comparison in a sentence or two.
 *
 * @param {Method[]} methods
 */
export function conclusion(methods) {
  const length = methods[0]?.found.frames.length ?? 0;
  if (length === 0) return "There are no frames to compare.";
  const on = `On these ${counted(length, "frame")}`;
  const ends = methods.map(({ found }) => found.frames.at(-1)?.counts ?? null);
  if (ends.some((counts) => counts === null)) {
    const results = methods.map(({ name, found: { frames } }) => {
      const seen = frames.filter(({ obstacles }) => obstacles.length > 0).length;
      return `${name} reported obstacles in ${counted(seen, "frame")}`;
    });
    return `${on}, ${results.join(", ")}. False obstacles and errors can only be counted with ground truth.`;
  }
  const wrong = ends.map((counts) => counts?.false ?? 0);
  const results = methods.map(({ name }, at) =>
    at === 0
      ? `${name} reported ${countOrNone(wrong[at])} false ${wrong[at] === 1 ? "obstacle" : "obstacles"}`
      : `${name} ${countOrNone(wrong[at])}`,
  );
  const errors = ends.map((counts) => counts?.velocity_rmse_mps ?? null);
  const known = methods.flatMap(({ name }, at) => {
    const error = errors[at] ?? null;
    return error === null ? [] : [`${fixed(error, 2)} m/s with ${name}`];
  });
  const second = known.length > 0 ? ` Velocity error: ${known.join(", ")}.` : "";
  return `${on}, ${results.join(", ")}.${second}`;
}

/**
 * Describe what one method found in a frame, for screen readers.
 *
 * @param {string} name
 * @param {FrameEntry | undefined} entry
 */
export function findingsInWords(name, entry) {
  if (!entry) return name;
  const moving = entry.obstacles.filter(({ motion }) => motion === "moving");
  const wrong = entry.obstacles.filter((each) => each.false).length;
  const speeds = moving.map(({ id, speed }) => `${id} at ${fixed(speed, 2)} m/s`).join(", ");
  return [
    `${name}: ${counted(entry.obstacles.length, "obstacle")}`,
    speeds && `moving: ${speeds}`,
    wrong > 0 && `${wrong} false`,
  ]
    .filter(Boolean)
    .join("; ");
}

/** Return the page's address of a split screen. @param {string[]} ids @param {number} [position] */
export function methodsHref(ids, position) {
  const frame = position === undefined ? "" : `/${position}`;
  return `#methods/${ids.map(encodeURIComponent).join(",")}${frame}`;
}

/** @param {string} hash of the page's address @returns {number | null} the frame it names */
export function positionOf(hash) {
  const found = /^#methods\/[^/]+\/(\d{1,9})$/.exec(hash);
  return found ? Number(found[1]) : null;
}

/**
 * Estimate how long the rest of a comparison takes.
 *
 * @param {{at: number, share: number}} began when it was first seen in progress, ms, and how far it was
 * @param {{at: number, share: number}} now
 * @returns {string} as in "about 40 s left"; empty while too little is known
 */
export function timeLeft(began, now) {
  const took_s = (now.at - began.at) / 1000;
  const done = now.share - began.share;
  if (took_s < JUDGED_AFTER_S || done <= 0) return "";
  const left_s = (took_s * (1 - now.share)) / done;
  const rounded = ROUNDED_S * Math.max(1, Math.round(left_s / ROUNDED_S));
  return `about ${durationInWords(rounded)} left`;
}

/** @param {number | undefined} count */
function countOrNone(count) {
  return count ? String(count) : "none";
}

/** @param {number[]} numbers */
function sum(numbers) {
  return numbers.reduce((total, each) => total + each, 0);
}
