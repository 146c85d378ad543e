/** The roles of the two possible robots. */

/** @import { RobotNow, WheelSpeed } from "../contract" */
/** @typedef {WheelSpeed["role"]} Role */

/** @type {Role[]} */
export const ROLES = ["observer", "obstacle"];

/** @type {Record<Role, string>} */
export const ROLE_WORDS = { observer: "Observer", obstacle: "Obstacle" };

/** Say whether its motors are on, as far as is known. @param {RobotNow | null} robot */
export function isArmed(robot) {
  return robot?.state === "armed" || robot?.state === "moving";
}
