/**
 * What the server says of robots and driving, as types. SI units, in the names or beside them;
 * places are in the robot's base frame (x forward, y left) unless they say otherwise.
 *
 * @typedef {"observer" | "obstacle"} Role
 *
 * @typedef {object} Velocity
 * @property {number} speed_mps forward
 * @property {number} turn_rate_radps positive to the left
 *
 * @typedef {object} SonarReading
 * @property {number} index
 * @property {number} x of the sonar
 * @property {number} y
 * @property {number} heading
 * @property {number | null} range_m null: nothing echoed
 * @property {number} received the host's monotonic clock
 *
 * @typedef {object} RobotReport the newest word of the robot itself
 * @property {string} phase
 * @property {string | null} trouble
 * @property {string | null} fault
 * @property {string[]} warnings
 * @property {number | null} received
 * @property {string | null} name
 * @property {string | null} model
 * @property {string | null} subtype
 * @property {{x: number, y: number, yaw: number} | null} odometry
 * @property {number | null} speed_mps by its encoders
 * @property {number | null} turn_rate_radps
 * @property {boolean | null} motors_enabled
 * @property {[boolean, boolean] | null} stalled left and right wheel
 * @property {boolean[]} front_bumpers
 * @property {boolean[]} rear_bumpers
 * @property {boolean | null} stop_pressed
 * @property {number | null} battery_v
 * @property {"good" | "low" | "critical" | null} battery
 * @property {string | null} charging
 * @property {number | null} temperature_c
 * @property {SonarReading[]} sonars
 * @property {number | null} watchdog_s
 * @property {{speed_mps: number, turn_rate_radps: number} | null} limits in force
 * @property {number | null} radius_m
 * @property {number | null} width_m
 * @property {number | null} length_m
 * @property {Record<string, number>} counters
 *
 * @typedef {object} GuardWord what the guard allows and why
 * @property {"clear" | "slow" | "stop"} level
 * @property {string | null} reason
 * @property {number | null} limit_mps
 * @property {number[][]} stop_zone
 * @property {number[][]} slow_zone
 *
 * @typedef {object} RobotFacts
 * @property {string} port
 * @property {string | null} name
 * @property {string | null} world
 * @property {"connecting" | "disarmed" | "armed" | "moving" | "waiting" | "refused"} state
 * @property {string | null} operator who holds its lease
 * @property {boolean} present whether that one gives signs of presence
 * @property {string | null} why it does not move as asked
 * @property {Velocity} commanded
 * @property {Velocity} sent
 * @property {GuardWord | null} guard
 * @property {RobotReport} report
 *
 * @typedef {object} RunningProgramme
 * @property {string} name
 * @property {number} elapsed_s
 * @property {number} duration_s
 * @property {number} round
 * @property {number} repeat
 * @property {boolean} reverse
 * @property {"gesture" | "driving"} phase
 *
 * @typedef {object} WheelSpeed of an armed robot
 * @property {Role} role
 * @property {number} time seconds, source clock
 * @property {number} sent_mps
 * @property {number | null} encoder_mps
 *
 * @typedef {object} DrivingFacts the live message `robots`
 * @property {{by: string, since: number} | null} stopped the latch
 * @property {{age_s: number | null, status: string | null, world: string | null} | null} [sight]
 * @property {RunningProgramme | null} programme
 * @property {Record<Role, RobotFacts | null>} robots
 * @property {{alive: boolean, pid: number | null, restarts: number, trouble?: string | null}} [process]
 * @property {string | null} [world] of the open source; null: it is only replayed
 * @property {Record<Role, string | null>} [trouble] why a role's robot could not be connected
 * @property {Incident[]} [incidents] oldest first
 * @property {WheelSpeed[]} [wheels] since the last message, oldest first
 * @property {Check | null} [check]
 * @property {Record<Role, {port: string, model: string | null} | null>} [ports] as kept
 *
 * @typedef {object} Incident something stopped a robot
 * @property {Role | null} role
 * @property {string} kind
 * @property {string} sentence
 * @property {number | null} speed_mps at that moment
 * @property {string} at ISO 8601
 * @property {Partial<Record<Role, StopFigures>>} [stops] of each robot that moved, once it stands
 *
 * @typedef {object} StopFigures a stop from its cause on; null: not known
 * @property {number | null} zero_ms until zero went out
 * @property {number | null} stood_ms until it stood
 * @property {number | null} distance_m driven meanwhile
 * @property {number | null} speed_mps at the cause
 * @property {number | null} separation_m left to what is seen or echoes ahead
 *
 * @typedef {object} CheckStep
 * @property {string} name
 * @property {string} title
 * @property {string} instruction
 * @property {"waiting" | "driving" | "passed" | "failed" | "skipped"} state
 * @property {string | null} sentence why the robot was stopped
 * @property {StopFigures | null} figures
 * @property {string | null} verdict how that compares with what is promised
 * @property {string | null} told of a stop that was not taken
 * @property {string | null} skipped_by
 *
 * @typedef {object} Check the guided check that goes on or ended last
 * @property {Role} role
 * @property {string} started_at
 * @property {string | null} ended_at
 * @property {"passed" | "failed" | "incomplete" | "given_up" | null} outcome
 * @property {number | null} present which step it is at
 * @property {CheckStep[]} steps
 * @property {string | null} record the name under which it is kept
 * @property {string | null} trouble why it could not be
 *
 * @typedef {object} CheckEntry one of GET /api/robots/checks
 * @property {string} name
 * @property {Role} role
 * @property {string} started_at
 * @property {"passed" | "failed" | "incomplete" | "given_up"} outcome
 * @property {string | null} note
 * @property {Record<string, string>} states by step
 *
 * @typedef {object} ProgrammeEntry one of GET /api/programmes
 * @property {string} name
 * @property {string} title
 * @property {string} help
 * @property {Role[]} roles
 * @property {number} duration_s
 * @property {boolean} own whether it was uploaded, so that it may be deleted
 *
 * @typedef {object} SentReply what really went out for one command
 * @property {number} speed_mps
 * @property {number} turn_rate_radps
 * @property {string | null} limited_by
 * @property {number} age_ms
 *
 * @typedef {object} LinkWord
 * @property {"good" | "slow" | "lost"} quality
 * @property {number | null} rtt_ms
 * @property {number | null} delay_ms
 * @property {string | null} sentence
 */

/** @type {import("./types.js").Role[]} */
export const ROLES = ["observer", "obstacle"];

/** Whether its motors are on, by the newest that is known. @param {RobotFacts | null} robot */
export function isArmed(robot) {
  return robot?.state === "armed" || robot?.state === "moving";
}
