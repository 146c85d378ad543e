/** The last minute of speeds, as aligned columns for the chart. No drawing here. */

import { isArmed, ROLES } from "./driving/types.js";
import { trackColour } from "./words.js";

/** @typedef {"estimate" | "truth" | "commanded" | "sent" | "encoder"} Kind */

/**
 * @typedef {object} Column
 * @property {string} key
 * @property {Kind} kind
 * @property {string} label
 * @property {number} colour which track colour; for sent and encoder 0 the observer, 1 the obstacle
 * @property {(number | null)[]} values m/s; null where there is none, which is drawn as a gap
 * @property {(number | null)[]} stds m/s
 */

// Where nothing came for longer than this there is a gap in the curves.
const JUMP_S = 1;
// Between the end of one playing and the start of the next.
const GAP_S = 0.5;

export class SpeedHistory {
  /** @type {number[]} seconds, rising also where the source was restarted */
  times = [];
  /** @type {Map<string, Column>} */
  columns = new Map();

  #offset = 0;
  #epoch = 0;
  #lastTime = 0;
  #lastSegment = 0;
  #lastSequence = -1;

  /** @param {number} span_s how much is kept */
  constructor(span_s) {
    this.span_s = span_s;
  }

  /**
   * @param {import("./types.js").ObservationMessage} message
   * @param {import("./driving/types.js").DrivingFacts | null} driving as newest told
   */
  add({ sequence, line, truth }, driving) {
    this.#continue(line.time, line.segment, sequence);
    this.#row(line.time + this.#offset);
    for (const obstacle of line.obstacles) {
      // While a track coasts nothing is measured: a gap, not a guess.
      if (obstacle.state === "coasting") continue;
      const key = `${this.#epoch}/${line.segment}/${obstacle.id}`;
      this.#put(key, "estimate", `Obstacle ${obstacle.id}`, trackColour(obstacle.id), obstacle.speed, obstacle.speed_std);
    }
    for (const body of truth) {
      if (body.role === "observer") continue;
      this.#put(`truth/${body.id}`, "truth", `Truth ${body.name}`, 0, body.speed, null);
      if (body.commanded_speed !== null && body.commanded_speed !== undefined) {
        this.#put(`commanded/${body.id}`, "commanded", `Commanded ${body.name}`, 0, body.commanded_speed, null);
      }
    }
    for (const [index, role] of ROLES.entries()) this.#putRobot(role, index, driving?.robots?.[role] ?? null);
    this.#forget();
  }

  /**
   * What a robot is told and what its wheels do, while it is armed; size only, as of obstacles.
   *
   * @param {import("./driving/types.js").Role} role
   * @param {number} colour
   * @param {import("./driving/types.js").RobotFacts | null} robot
   */
  #putRobot(role, colour, robot) {
    if (!robot || !isArmed(robot)) return;
    this.#put(`sent/${role}`, "sent", `Sent to ${role}`, colour, Math.abs(robot.sent.speed_mps), null);
    const { speed_mps } = robot.report;
    if (speed_mps !== null) this.#put(`encoder/${role}`, "encoder", `Wheels of ${role}`, colour, Math.abs(speed_mps), null);
  }

  /**
   * @param {number} time
   * @param {number} segment
   * @param {number} sequence
   */
  #continue(time, segment, sequence) {
    const newest = this.times.at(-1);
    const ahead = time - this.#lastTime;
    const anew = segment !== this.#lastSegment || sequence <= this.#lastSequence || ahead <= 0;
    if (newest !== undefined && (anew || ahead > JUMP_S)) this.#row(newest + GAP_S / 2);
    if (newest !== undefined && anew) {
      this.#epoch += 1;
      this.#offset = newest + GAP_S - time;
    }
    this.#lastTime = time;
    this.#lastSegment = segment;
    this.#lastSequence = sequence;
  }

  /** @param {number} time a row without values yet */
  #row(time) {
    this.times.push(time);
    for (const column of this.columns.values()) {
      column.values.push(null);
      column.stds.push(null);
    }
  }

  /**
   * @param {string} key
   * @param {Kind} kind
   * @param {string} label
   * @param {number} colour
   * @param {number} value
   * @param {number | null} std
   */
  #put(key, kind, label, colour, value, std) {
    let column = this.columns.get(key);
    if (!column) {
      const blank = () => this.times.map(() => null);
      column = { key, kind, label, colour, values: blank(), stds: blank() };
      this.columns.set(key, column);
    }
    column.values[this.times.length - 1] = value;
    column.stds[this.times.length - 1] = std;
  }

  #forget() {
    const oldest = (this.times.at(-1) ?? 0) - this.span_s;
    const keepFrom = this.times.findIndex((time) => time >= oldest);
    // Not for every row: moving a thousand numbers is dearer than keeping a few too many.
    if (keepFrom < 50) return;
    this.times.splice(0, keepFrom);
    for (const [key, column] of this.columns) {
      column.values.splice(0, keepFrom);
      column.stds.splice(0, keepFrom);
      if (column.values.every((value) => value === null)) this.columns.delete(key);
    }
  }
}
