/** The observer's goal in words. Pure functions. */

import { FARTHEST_GOAL_M } from "../elements/facts.js";
import { fixed, sentence } from "../elements/words.js";
import { outdatedReason } from "./robot-words.js";
import { isArmed } from "./roles.js";

/** @import { FloorPlace } from "../shell/floor-pick.js" */
/** @import { Hub } from "../shell/hub.js" */

/** The parameter that sets the risk of goals sent without one. */
export const RISK_PARAMETER = "navigation.risk_per_metre";

/**
 * Choices for the accepted probability of contact per metre: the value sent and its words.
 *
 * @param {unknown} usual the server's default; undefined while unknown
 * @returns {string[][]}
 */
export function riskChoices(usual) {
  const others = [
    ["0.0001", "0.0001 – waits longest"],
    ["0.001", "0.001"],
    ["0.01", "0.01 – waits least"],
  ];
  return [
    ["", usual === undefined ? "Default" : `${usual} – default`],
    ...others.filter(([value]) => Number(value) !== usual),
  ];
}

/**
 * Say what must be done before the observer can be sent to a goal.
 *
 * @param {Pick<Hub, "connection" | "robots" | "robotsOutdated">} hub
 * @param {boolean} ours whether this page holds the observer's lease
 * @param {string} programme title of the programme that moves the observer; empty for none
 * @returns {string} a sentence; empty if nothing is missing
 */
export function missingForGoal({ connection, robots: facts, robotsOutdated }, ours, programme) {
  if (connection !== "open" || (facts && robotsOutdated))
    return outdatedReason({ connection, robots: facts });
  if (!facts) return "Waiting for robot status.";
  const robot = facts.robots?.observer;
  if (facts.stopped) return "All robots are stopped: reset the stop first.";
  if (!robot) return "Connect the observer first.";
  if (robot.operator && !ours) return "Take control of the observer first.";
  if (!ours || !isArmed(robot)) return "Arm the observer first.";
  if (programme) return `The programme ${programme} is running: stop it first.`;
  return "";
}

/**
 * Parse a typed place.
 *
 * @param {string} ahead
 * @param {string} left
 * @returns {FloorPlace | string} a sentence if it is not a valid place
 */
export function parseGoal(ahead, left) {
  const [x, y] = [ahead, left].map((text) => (text.trim() === "" ? NaN : Number(text)));
  if (x === undefined || y === undefined || !Number.isFinite(x) || !Number.isFinite(y))
    return "Enter both distances in metres, as in 2.5.";
  return tooFarReason({ ahead: x, left: y }) || { ahead: x, left: y };
}

/** Say why a place is too far away; empty if it is not. @param {FloorPlace} place */
export function tooFarReason({ ahead, left }) {
  const distance = Math.hypot(ahead, left);
  return distance > FARTHEST_GOAL_M
    ? `The place is ${fixed(distance, 1)} m away. A goal must be within ${FARTHEST_GOAL_M} m.`
    : "";
}

/** @param {FloorPlace} place @returns {string} as in "2.00 m ahead, 0.50 m to the right" */
export function placeInWords({ ahead, left }) {
  const parts = [
    [ahead, "ahead", "behind"],
    [left, "to the left", "to the right"],
  ].flatMap(([value, plus, minus]) => {
    const size = fixed(Math.abs(Number(value)), 2);
    return Number(size) === 0 ? [] : [`${size} m ${Number(value) > 0 ? plus : minus}`];
  });
  return parts.join(", ") || "where the robot stands";
}

/** Begin a refusal with what did not happen. @param {string} what @param {string} why */
export function refusalSentence(what, why) {
  return sentence(`${what}: ${why.charAt(0).toLowerCase()}${why.slice(1)}`);
}

/**
 * Strip the numbers from a sentence: screen readers should announce new sentences, not new
 * numbers.
 *
 * @param {string} words
 */
export function stripNumbers(words) {
  return words.replace(/\d+(\.\d+)?/g, "");
}
