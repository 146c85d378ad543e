/** Why the observer drives as it does on its way to a goal, in words. Pure functions. */

import { fixed } from "./words.js";

/** @import { GoalNow, RefusedPath } from "../contract" */
/** @import { Figure } from "./figure-list.js" */

// Directions are rounded to this.
const STEP_DEG = 5;

/** @param {GoalNow} goal @returns {Figure[]} */
export function figuresOfGoal(goal) {
  const planned = goal.planned_risk_per_metre;
  const risks = [
    `${goal.risk_per_metre} accepted`,
    ...(planned === null ? [] : [`${shortNumber(planned)} planned`]),
  ];
  return [
    ["Decided by", deciderInWords(goal)],
    ["Risk per metre", risks.join(", ")],
  ];
}

/** @param {GoalNow} goal @returns {string} as in "obstacle 3: driving straight on, the robot would meet it in 1.4 s" */
function deciderInWords({ waits_for, meets_s }) {
  if (waits_for === null) return "no obstacle";
  const when =
    meets_s === null
      ? ""
      : `: driving straight on, the robot would meet it in ${fixed(meets_s, 1)} s`;
  return `${trackInWords(waits_for)}${when}`;
}

/** List the rejected paths, from left to right as in the scene. @param {GoalNow} goal */
export function refusalsInWords({ refused }) {
  return [...refused]
    .sort((one, other) => other.direction - one.direction)
    .map((path) => refusedInWords(path));
}

/** @param {RefusedPath} path @returns {string} as in "Left by 45° at 0.5 m/s: would meet obstacle 3 in 1.2 s (risk per metre 0.04)." */
function refusedInWords(path) {
  const begin = `${directionInWords(path.direction)} at ${fixed(path.speed_mps, 1)} m/s`;
  return `${begin}: ${causeInWords(path)}.`;
}

/** @param {RefusedPath} path */
function causeInWords({ cause, track, meets_s, risk, guard }) {
  if (cause === "guard") return guard ? `rejected by the guard, ${guard}` : "rejected by the guard";
  const when = meets_s === null ? "" : ` in ${fixed(meets_s, 1)} s`;
  if (cause === "surface") return `would reach an obstruction${when}`;
  const encounter = `would meet ${track === null ? "an obstacle" : trackInWords(track)}${when}`;
  if (risk === null) return encounter;
  const detail =
    cause === "risk"
      ? `risk per metre ${shortNumber(risk)}`
      : `probability ${shortNumber(100 * risk)} %`;
  return `${encounter} (${detail})`;
}

/** @param {number} direction radians to the left @returns {string} as in "Left by 45°" */
function directionInWords(direction) {
  const degrees = STEP_DEG * Math.round((direction * 180) / Math.PI / STEP_DEG);
  if (degrees === 0) return "Straight on";
  return `${degrees > 0 ? "Left" : "Right"} by ${Math.abs(degrees)}°`;
}

/** @param {number} track negative: it starts to move and has no number yet @returns {string} */
function trackInWords(track) {
  return track < 0 ? "an object that has started to move" : `obstacle ${track}`;
}

/** @param {number} value @returns {string} one significant digit, two from 10 on: as in "0.0002" */
function shortNumber(value) {
  if (value === 0) return "0";
  if (value < 0.00001) return "below 0.00001";
  return String(Number(value.toPrecision(value >= 10 ? 2 : 1)));
}
