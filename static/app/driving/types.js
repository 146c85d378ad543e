/**
 * What the server says of robots and driving, by the names that the page uses; see `../types.js`.
 * SI units; places are in the robot's base frame (x forward, y left) unless they say otherwise.
 *
 * @typedef {"observer" | "obstacle"} Role
 * @typedef {import("../contract").Velocity} Velocity
 * @typedef {import("../contract").SonarReading} SonarReading
 * @typedef {import("../contract").RobotReport} RobotReport
 * @typedef {import("../contract").GuardVerdict} GuardWord
 * @typedef {import("../contract").RobotNow} RobotFacts
 * @typedef {import("../contract").ProgrammeNow} RunningProgramme
 * @typedef {import("../contract").WheelSpeed} WheelSpeed
 * @typedef {import("../contract").RobotsMessage} DrivingFacts
 * @typedef {import("../contract").RobotIncident} Incident
 * @typedef {import("../contract").StopMeasured} StopFigures
 * @typedef {import("../contract").CheckStep} CheckStep
 * @typedef {import("../contract").CheckNow} Check
 * @typedef {import("../contract").CheckEntry} CheckEntry
 * @typedef {import("../contract").ProgrammeEntry} ProgrammeEntry
 * @typedef {import("../contract").SentMessage} SentReply
 * @typedef {import("../contract").LinkMessage} LinkWord
 */

/** @type {import("./types.js").Role[]} */
export const ROLES = ["observer", "obstacle"];

/** Whether its motors are on, by the newest that is known. @param {RobotFacts | null} robot */
export function isArmed(robot) {
  return robot?.state === "armed" || robot?.state === "moving";
}
