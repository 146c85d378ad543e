/** The robot from above: its outline, the guard's zones and its sonar echoes. */

import { setAttribute, svg } from "../elements/dom.js";

/** @import { RobotNow, SonarReading } from "../contract" */

const REACH_M = 3;
const RINGS_M = [1, 2, 3];
const NEAR_M = 0.5;
const CLOSE_M = 1;
const OLD_S = 1;

/** Draws x upwards and y to the left, in metres. */
export class SonarRing {
  element = svg("svg", {
    viewBox: `${-REACH_M - 0.1} ${-REACH_M - 0.1} ${2 * REACH_M + 0.2} ${2 * REACH_M + 0.2}`,
    class: "sonar-ring",
    role: "img",
  });
  #slow = svg("polygon", { class: "zone slow" });
  #stop = svg("polygon", { class: "zone stop" });
  #arcs = svg("g", {});
  #body = svg("g", { class: "outline" });
  #drawn = "";

  constructor() {
    this.element.append(
      ...RINGS_M.map((r) => svg("circle", { r, class: "scale" })),
      ...RINGS_M.map((r) => label(r)),
      this.#slow,
      this.#stop,
      this.#arcs,
      this.#body,
    );
  }

  /** @param {RobotNow | null} robot @param {number} halfAngle of a sonar's cone, degrees */
  show(robot, halfAngle) {
    const { report, guard } = robot ?? {};
    this.#zone(this.#slow, guard?.slow_zone, guard?.level);
    this.#zone(this.#stop, guard?.stop_zone, guard?.level);
    this.#showBody(robot);
    const now = Math.max(
      report?.received ?? 0,
      ...(report?.sonars ?? []).map(({ received }) => received),
    );
    const readings = (report?.sonars ?? []).filter(({ range_m }) => range_m !== null);
    while (this.#arcs.childElementCount > readings.length) this.#arcs.lastElementChild?.remove();
    readings.forEach((reading, index) => {
      const arc = this.#arcs.children[index] ?? this.#arcs.appendChild(svg("path", {}));
      const range = reading.range_m ?? 0;
      const age = now - reading.received;
      setAttribute(arc, "d", arcOf(reading, Math.min(range, REACH_M), halfAngle));
      setAttribute(
        arc,
        "data-range",
        range < NEAR_M ? "near" : range < CLOSE_M ? "close" : range > REACH_M ? "beyond" : "far",
      );
      setAttribute(arc, "data-old", age > OLD_S ? "" : null);
      setAttribute(arc, "opacity", Math.max(0.25, 1 - 0.6 * age).toFixed(2));
    });
    setAttribute(this.element, "aria-label", `Top view of the robot. ${sonarInWords(robot)}`);
  }

  /** @param {RobotNow | null} robot */
  #showBody(robot) {
    const { width_m, length_m, radius_m } = robot?.report ?? {};
    const key = `${width_m} ${length_m} ${radius_m} ${robot?.state}`;
    if (key === this.#drawn) return;
    this.#drawn = key;
    this.#body.replaceChildren();
    if (!robot) return;
    const width = width_m ?? 2 * (radius_m ?? 0.2);
    const length = length_m ?? 2 * (radius_m ?? 0.2);
    this.#body.append(
      svg("rect", { x: -width / 2, y: -length / 2, width, height: length, rx: 0.08 }),
      svg("path", {
        d: `M0 0V${-length / 2 - 0.22}M-0.1 ${-length / 2 - 0.1}L0 ${-length / 2 - 0.24}L0.1 ${-length / 2 - 0.1}`,
      }),
    );
  }

  /**
   * @param {SVGElement} polygon
   * @param {number[][] | undefined} places
   * @param {string | undefined} level
   */
  #zone(polygon, places, level) {
    setAttribute(
      polygon,
      "points",
      (places ?? []).map(([x = 0, y = 0]) => `${(-y).toFixed(3)},${(-x).toFixed(3)}`).join(" "),
    );
    setAttribute(polygon, "data-level", level ?? null);
  }
}

/**
 * Say how far away the nearest echo is.
 *
 * @param {RobotNow | null} robot
 */
export function sonarInWords(robot) {
  const sonars = robot?.report.sonars ?? [];
  if (sonars.length === 0) return "No sonar";
  const now = Math.max(robot?.report.received ?? 0, ...sonars.map(({ received }) => received));
  const ranges = sonars.flatMap(({ range_m }) => (range_m === null ? [] : [range_m]));
  const oldest = now - Math.min(...sonars.map(({ received }) => received));
  const nearest = ranges.length ? `nearest ${Math.min(...ranges).toFixed(2)}\u00a0m` : "no echo";
  return `Sonar: ${nearest}, up to ${oldest.toFixed(1)}\u00a0s old`;
}

/** @param {SonarReading} reading @param {number} range @param {number} halfAngle degrees */
function arcOf({ x, y, heading }, range, halfAngle) {
  const half = (halfAngle * Math.PI) / 180;
  const at = (/** @type {number} */ angle) =>
    `${(-(y + range * Math.sin(angle))).toFixed(3)} ${(-(x + range * Math.cos(angle))).toFixed(3)}`;
  // On the screen, right to left is counterclockwise (sweep flag 0).
  return `M${at(heading - half)}A${range.toFixed(3)} ${range.toFixed(3)} 0 0 0 ${at(heading + half)}`;
}

/** @param {number} metres */
function label(metres) {
  return svg("text", { x: 0.06, y: metres - 0.06 }, `${metres} m`);
}
