/** Robots in words. Pure functions. */

import { fixed, sentence } from "../elements/words.js";
import { ROLE_WORDS } from "./roles.js";

/** @import { RobotIncident, RobotNow, RobotReport, RobotsMessage, SentMessage, StopMeasured } from "../contract" */
/** @import { Hub } from "../shell/hub.js" */
/** @import { Role } from "./roles.js" */

/** @type {Record<RobotNow["state"], string>} */
const STATES = {
  connecting: "Connecting",
  disarmed: "Disarmed",
  armed: "Armed",
  moving: "Moving",
  waiting: "Unreachable",
  refused: "Refused",
};

/** @param {RobotNow | null} robot */
export function stateInWords(robot) {
  return robot ? (STATES[robot.state] ?? robot.state) : "No robot";
}

/**
 * Say why what is known of the robots is outdated.
 *
 * @param {Pick<Hub, "connection" | "robots">} hub
 */
export function outdatedReason({ connection, robots }) {
  if (connection !== "open") return "No connection to the server.";
  if (robots?.process?.alive !== false) return "The server is not responding.";
  return sentence(
    robots.process.trouble ??
      "the drive process is restarting; until then, only the robots' own firmware can stop them",
  );
}

/**
 * Say who stopped all robots.
 *
 * @param {{by: string}} stopped
 * @param {string} operator name of the operator at this page; empty if it has none
 */
export function stopperInWords({ by }, operator) {
  return `Stopped by ${by === operator ? "you" : by}`;
}

/**
 * Say in one sentence why a robot is standing still.
 *
 * @param {Role} role
 * @param {RobotNow | null} robot
 * @param {RobotsMessage | null} facts
 * @param {boolean} ours whether this page holds its lease
 * @param {string} operator name of the operator at this page; empty if it has none
 */
export function standstillReason(role, robot, facts, ours, operator) {
  if (!robot) return missingRobotReason(role, facts);
  if (facts?.stopped)
    return `${stopperInWords(facts.stopped, operator)}. Reset the stop at the top of the page to continue.`;
  const { fault, trouble } = robot.report;
  if (fault) return sentence(fault);
  if (["connecting", "waiting", "refused"].includes(robot.state)) {
    return sentence(trouble ?? robot.why ?? "connecting to the robot");
  }
  if (role === "observer" && facts?.goal?.state === "driving")
    return "Driving to a goal autonomously.";
  // Why it is slower than requested is shown next to what is sent.
  if (robot.state === "moving") return "The robot is moving.";
  if (robot.why) return sentence(robot.why);
  if (robot.state === "armed")
    return ours
      ? "Armed. Hold the pad, a key or the gamepad to drive."
      : "Armed. Another operator has control.";
  return "Motors are off. Arm the robot to drive.";
}

/**
 * Say why a robot stands still although a control is held.
 *
 * @param {SentMessage | null | undefined} reply to the newest command
 * @returns {string} empty if it is sent more than zero
 */
export function heldBackReason(reply) {
  const limit = reply?.limited_by;
  if (!limit || reply.speed_mps !== 0 || reply.turn_rate_radps !== 0) return "";
  return sentence(limit);
}

/** Say why there is no robot. @param {Role} role @param {RobotsMessage | null} facts */
function missingRobotReason(role, facts) {
  const trouble = facts?.process?.trouble ?? facts?.trouble?.[role];
  if (!facts) return "Waiting for robot status.";
  if (trouble) return sentence(trouble);
  if (facts.ports?.[role] && facts.world !== "real") {
    return "Real robots can be driven only while live cameras are the current source.";
  }
  return facts.world === null
    ? "The current source has no robots. Open live cameras or a simulated source."
    : "No robot is connected. Enter its port below.";
}

/**
 * @param {RobotNow | null} robot
 * @param {boolean} ours
 */
export function driverInWords(robot, ours) {
  if (!robot) return "";
  if (ours) return "You have control";
  if (!robot.operator) return "Nobody has control";
  return `${robot.operator} has control${robot.present ? "" : ", but is not present"}`;
}

/** @param {RobotReport} report */
export function batteryInWords({ battery_v, battery, charging }) {
  if (battery_v === null) return "–";
  const parts = [`${fixed(battery_v, 1)} V`];
  if (battery && battery !== "good") parts.push(battery);
  if (charging && !["no", "none", "not charging"].includes(charging)) parts.push(charging);
  return parts.join(", ");
}

/**
 * Return term, value and help for every figure shown for a robot.
 *
 * @param {RobotNow} robot
 * @returns {[string, string, string][]}
 */
export function figuresOf({ report, sent }) {
  const { odometry, limits, counters } = report;
  return [
    ["Speed sent", `${fixed(sent.speed_mps, 2)} m/s`, "speed actually sent to the robot"],
    [
      "Wheel encoders",
      report.speed_mps === null ? "–" : `${fixed(report.speed_mps, 2)} m/s`,
      "speed measured at the wheels",
    ],
    ["Turn rate sent", `${fixed(degrees(sent.turn_rate_radps), 0)} °/s`, "positive to the left"],
    [
      "Turn rate measured",
      report.turn_rate_radps === null ? "–" : `${fixed(degrees(report.turn_rate_radps), 0)} °/s`,
      "positive to the left",
    ],
    [
      "Wheel odometry",
      odometry
        ? `${fixed(odometry.x, 2)}, ${fixed(odometry.y, 2)} m, ${fixed(degrees(odometry.yaw), 0)}°`
        : "–",
      "since it connected: forward, left, heading",
    ],
    ["Battery", batteryInWords(report), "averaged"],
    ["Motors", onOff(report.motors_enabled), "as reported by the robot"],
    ["Wheels", stallInWords(report.stalled), "a wheel stalls when something blocks the robot"],
    ["Bumpers", bumpersInWords(report), "numbers of the pressed bumpers, counted from the left"],
    [
      "Hardware stop",
      report.stop_pressed === null ? "–" : report.stop_pressed ? "pressed" : "not pressed",
      "the button on the robot itself",
    ],
    [
      "Robot watchdog",
      watchdogInWords(report.watchdog_s),
      "the robot's firmware stops it this long after the last command",
    ],
    [
      "Speed limit",
      limits ? `${fixed(limits.speed_mps, 2)} m/s` : "–",
      "the lowest limit of robot, model and settings",
    ],
    [
      "Temperature",
      report.temperature_c === null ? "–" : `${fixed(report.temperature_c, 0)} °C`,
      "inside the robot",
    ],
    [
      "Packets, corrupted",
      `${counters.packets ?? 0}, ${counters.bad_packets ?? 0}`,
      "status packets received, and how many of them were corrupted",
    ],
  ];
}

/** @param {RobotIncident} incident */
export function incidentInWords({ at, role, kind, sentence: words, speed_mps, stops }) {
  const date = new Date(at);
  const time = Number.isNaN(date.getTime()) ? at : date.toLocaleTimeString();
  const speed = speed_mps === null ? "" : ` (at ${fixed(speed_mps, 2)} m/s)`;
  const what = [sentence(words).replace(/\.$/, ""), ...Object.values(stops ?? {}).map(stopInWords)];
  // Only the observer drives to goals.
  const who = role ?? (kind === "goal" ? "observer" : null);
  // The sentence about a stop names all robots.
  const whose = who ? ROLE_WORDS[who] : kind === "stop" ? "" : "Both robots";
  return `${[time, whose].filter(Boolean).join(" ")}${speed}: ${sentence(what.join("; "))}`;
}

/** @param {StopMeasured} figures @returns {string} as in "stop command sent after 220 ms; standstill after 610 ms and 0.12 m" */
export function stopInWords({ zero_ms, stood_ms, distance_m, separation_m }) {
  const way = distance_m === null ? "" : ` and ${fixed(distance_m, 2)} m`;
  return [
    zero_ms === null ? "no stop command sent" : `stop command sent after ${fixed(zero_ms, 0)} ms`,
    stood_ms === null
      ? "standstill not observed"
      : `standstill after ${fixed(stood_ms, 0)} ms${way}`,
    separation_m === null ? null : `${fixed(separation_m, 2)} m clearance`,
  ]
    .filter(Boolean)
    .join("; ");
}

/** @param {number} radians */
export function degrees(radians) {
  return (radians * 180) / Math.PI;
}

/** @param {number} radps positive to the left @returns {string} as in "12 °/s to the left" */
export function turnInWords(radps) {
  const whole = Math.round(Math.abs(degrees(radps)));
  return whole === 0 ? "straight" : `${whole} °/s to the ${radps > 0 ? "left" : "right"}`;
}

/**
 * Say how fast a robot drives and turns.
 *
 * @param {{speed_mps: number, turn_rate_radps: number}} velocity
 */
export function velocityInWords({ speed_mps: speed, turn_rate_radps: turn }) {
  const words = turnInWords(turn);
  const still = Number(speed.toFixed(2)) === 0 && words === "straight";
  return still ? "standstill" : `${fixed(speed, 2)} m/s, ${words}`;
}

/**
 * Say what must be done first.
 *
 * @param {[act: string, role: string][]} steps as in "arm" the "observer"
 * @returns {string} one sentence, empty if nothing
 */
export function firstSteps(steps) {
  /** @type {Map<string, string[]>} */
  const roles = new Map();
  for (const [act, role] of steps) roles.set(act, [...(roles.get(act) ?? []), `the ${role}`]);
  const words = [...roles].map(([act, those]) => `${act} ${those.join(" and ")}`);
  return words.length ? sentence(`${words.join(" and ")} first`) : "";
}

/** @param {boolean | null} value */
function onOff(value) {
  return value === null ? "–" : value ? "on" : "off";
}

/** @param {RobotReport["stalled"]} stalled */
function stallInWords(stalled) {
  if (!stalled) return "–";
  const [left, right] = stalled;
  if (left && right) return "both stalled";
  return left || right ? `${left ? "left" : "right"} stalled` : "turning freely";
}

/** @param {number | null} seconds */
function watchdogInWords(seconds) {
  if (seconds === null) return "–";
  return seconds === 0 ? "off" : `${fixed(seconds, 1)} s`;
}

/** @param {RobotReport} report */
function bumpersInWords({ front_bumpers, rear_bumpers }) {
  if (front_bumpers.length + rear_bumpers.length === 0) return "none fitted";
  const words = [
    ["front", front_bumpers],
    ["rear", rear_bumpers],
  ].flatMap(([name, pressed]) => {
    const numbers = /** @type {boolean[]} */ (pressed).flatMap((each, index) =>
      each ? [index + 1] : [],
    );
    return numbers.length ? [`${name} ${numbers.join(", ")}`] : [];
  });
  return words.join("; ") || "none pressed";
}

/** @param {number} seconds @returns {string} as in "1:05" */
export function clock(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}
