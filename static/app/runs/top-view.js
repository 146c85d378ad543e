/** A recorded frame from above, to scale: camera and its trail, obstacles, ground truth. */

import { h, setAttribute, setText, svg, tint } from "../elements/dom.js";
import { OBSTACLE_COLOURS } from "../elements/facts.js";
import { fixed, stateColour, STATE_WORDS } from "../elements/words.js";
import { matrixOf, outlinesOf } from "./map-cells.js";
import { boundsOf, gridOf } from "./top-view-bounds.js";

/** @import { FrameEntry, FramePlan, PlanBody, PlanMap, PlanObstacle } from "../contract" */

const LABEL_PX = 12;
const CAMERA_PX = 11;
const DOT_PX = 4;
const GOAL_PX = 7;
const HEAD_PX = 7;
const TRAIL_POINTS = 300;
/** @type {[keyof typeof STATE_WORDS, string][]} */
const STATES = [
  ["moving", "Red"],
  ["in_place", "Orange"],
  ["stopped", "Blue"],
  ["coasting", "Grey"],
];

/** Fills its container. Ahead is up; the scale is constant over a segment. */
export class TopView extends HTMLElement {
  #drawing = svg("svg", { role: "img", class: "top-view" });
  #scale = h("p.hint");
  /** @type {readonly FrameEntry[]} */
  #frames = [];
  /** @type {FrameEntry | null} */
  #shown = null;
  /** @type {PlanMap | null} */
  #map = null;
  #kept = { of: "", bounds: { ahead: 0, left: 0, perMetre: 1 } };
  #resized = new ResizeObserver(() => this.#draw());

  connectedCallback() {
    if (!this.childElementCount) this.append(this.#drawing, this.#scale);
    this.#resized.observe(this);
  }

  disconnectedCallback() {
    this.#resized.disconnect();
  }

  /** @param {readonly FrameEntry[]} frames spread over the whole run, in order */
  take(frames) {
    this.#frames = frames;
    this.#shown = this.#map = null;
    this.#kept.of = "";
    this.#draw();
  }

  /**
   * @param {FrameEntry | null} entry
   * @param {PlanMap | null} [map] the local map valid at that frame
   */
  show(entry, map = null) {
    this.#shown = entry;
    this.#map = map;
    this.#draw();
  }

  #draw() {
    const plan = this.#shown?.plan;
    const { clientWidth: wide, clientHeight: high } = this.#drawing;
    if (!plan || wide === 0 || high === 0) return this.#drawing.replaceChildren();
    const { ahead, left, perMetre } = this.#bounds(plan.segment, wide, high);
    // From metres ahead and to the left to pixels right and down.
    const place = (/** @type {readonly number[]} */ [x = 0, y = 0]) =>
      /** @type {[number, number]} */ ([
        wide / 2 - (y - left) * perMetre,
        high / 2 - (x - ahead) * perMetre,
      ]);
    const step = gridOf(perMetre);
    const brush = new Brush(place, perMetre);
    setAttribute(this.#drawing, "viewBox", `0 0 ${wide} ${high}`);
    setAttribute(this.#drawing, "aria-label", inWords(plan));
    this.#drawing.replaceChildren(
      ...(this.#map ? [brush.map(this.#map)] : []),
      ...gridLines(wide, high, step, ahead, left, perMetre),
      brush.line("camera-trail", this.#trail(plan)),
      ...plan.truth.map((body) => brush.body(body)),
      ...(plan.goal ? brush.way(plan.goal, plan.path) : []),
      ...plan.obstacles.map((obstacle) => brush.obstacle(obstacle)),
      ...brush.camera(plan.camera),
    );
    setText(
      this.#scale,
      `Top view, grid ${step} m. Ellipses: 95 %. Arrows: 1 s of motion.${this.#states()}${plan.truth.length > 0 ? " Dashed: ground truth." : ""}${plan.goal ? " Violet: goal and planned path." : ""}${this.#map ? " Local map: green is free, brown is obstructed." : ""}`,
    );
  }

  /**
   * @param {number} segment
   * @param {number} wide px
   * @param {number} high px
   */
  #bounds(segment, wide, high) {
    const of = [segment, wide, high].join(" ");
    if (this.#kept.of !== of) {
      const frames = this.#frames.filter(({ plan }) => plan.segment === segment);
      this.#kept = { of, bounds: boundsOf(frames, wide, high) };
    }
    return this.#kept.bounds;
  }

  /** Name the colours of the states that occur in the run. */
  #states() {
    const found = new Set(
      this.#frames.flatMap(({ plan }) => plan.obstacles.map((obstacle) => stateColour(obstacle))),
    );
    const named = STATES.filter(([state]) => found.has(OBSTACLE_COLOURS[state]));
    return named.map(([state, colour]) => ` ${colour}: ${STATE_WORDS[state]}.`).join("");
  }

  /** Return the camera's positions so far in this segment. @param {FramePlan} now */
  #trail(now) {
    const before = this.#frames
      .map(({ plan }) => plan)
      .filter(({ segment, camera, time }) => segment === now.segment && camera && time < now.time);
    const every = Math.ceil(before.length / TRAIL_POINTS);
    return [...before.filter((_, k) => k % every === 0), now].flatMap(({ camera }) =>
      camera ? [camera] : [],
    );
  }
}

class Brush {
  /**
   * @param {(at: readonly number[]) => [number, number]} place
   * @param {number} perMetre pixels
   */
  constructor(place, perMetre) {
    this.place = place;
    this.perMetre = perMetre;
  }

  /** @param {PlanMap} map */
  map(map) {
    const { free, blocked } = outlinesOf(map);
    const matrix = matrixOf(map, this.place(map.corner), this.perMetre);
    return svg(
      "g",
      {
        class: "local-map",
        transform: `matrix(${matrix.map((each) => each.toFixed(3)).join(" ")})`,
      },
      svg("path", { class: "free", d: free }),
      svg("path", { class: "blocked", d: blocked }),
    );
  }

  /** @param {string} what class of the line @param {readonly (readonly number[])[]} places */
  line(what, places) {
    const points = places.map((at) =>
      this.place(at)
        .map((value) => value.toFixed(1))
        .join(","),
    );
    return svg("polyline", { class: what, points: points.join(" ") });
  }

  /** @param {readonly number[]} goal @param {readonly (readonly number[])[]} path */
  way(goal, path) {
    const [x, y] = this.place(goal);
    return [
      this.line("planned-path", path),
      svg("circle", { class: "goal", cx: x.toFixed(1), cy: y.toFixed(1), r: GOAL_PX }),
    ];
  }

  /** @param {readonly number[] | null} camera ahead, left, angle */
  camera(camera) {
    if (!camera) return [];
    const [x, y] = this.place(camera);
    const turn = (-180 / Math.PI) * Number(camera[2]);
    return [
      svg("path", {
        class: "camera",
        transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${turn.toFixed(1)})`,
        d: `M0 ${-CAMERA_PX}L${0.65 * CAMERA_PX} ${0.7 * CAMERA_PX}L0 ${0.35 * CAMERA_PX}L${-0.65 * CAMERA_PX} ${0.7 * CAMERA_PX}z`,
      }),
    ];
  }

  /** @param {PlanObstacle} obstacle */
  obstacle(obstacle) {
    const { id, at, velocity, ellipse, state, motion } = obstacle;
    const [x, y] = this.place(at);
    const [along = 0, across = 0, angle = 0] = ellipse ?? [];
    const moves = velocity && motion === "moving" ? velocity : null;
    const group = svg(
      "g",
      { class: "track", "data-state": state },
      svg("ellipse", {
        rx: Math.max(1, along * this.perMetre).toFixed(1),
        ry: Math.max(1, across * this.perMetre).toFixed(1),
        // The angle is measured from ahead (up) to the left.
        transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${((-180 / Math.PI) * angle - 90).toFixed(1)})`,
      }),
      svg("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: DOT_PX }),
      ...(moves ? [this.#arrow(at, moves)] : []),
      svg("text", { x: x + 8, y: y - 7, "font-size": LABEL_PX }, String(id)),
    );
    return tint(/** @type {any} */ (group), stateColour(obstacle));
  }

  /** @param {PlanBody} body */
  body({ at, velocity }) {
    const [x, y] = this.place(at);
    const moves = Math.hypot(...velocity) > 0.02;
    return svg(
      "g",
      { class: "true-body" },
      svg("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: 8 }),
      ...(moves ? [this.#arrow(at, velocity)] : []),
    );
  }

  /** @param {readonly number[]} at @param {readonly number[]} velocity */
  #arrow(at, velocity) {
    const [x0, y0] = this.place(at);
    const [x1, y1] = this.place(at.map((value, axis) => value + Number(velocity[axis])));
    const angle = Math.atan2(y1 - y0, x1 - x0);
    const side = (/** @type {number} */ turn) =>
      `${(x1 - HEAD_PX * Math.cos(angle + turn)).toFixed(1)} ${(y1 - HEAD_PX * Math.sin(angle + turn)).toFixed(1)}`;
    return svg("path", {
      class: "arrow",
      d: `M${x0.toFixed(1)} ${y0.toFixed(1)}L${x1.toFixed(1)} ${y1.toFixed(1)}M${side(-0.5)}L${x1.toFixed(1)} ${y1.toFixed(1)}L${side(0.5)}`,
    });
  }
}

/**
 * @param {number} wide px
 * @param {number} high px
 * @param {number} step metres
 * @param {number} ahead metres, of the centre
 * @param {number} left metres, of the centre
 * @param {number} perMetre px
 */
function gridLines(wide, high, step, ahead, left, perMetre) {
  const lines = [];
  const rows = high / 2 / perMetre;
  for (let x = Math.ceil((ahead - rows) / step) * step; x <= ahead + rows; x += step) {
    const y = high / 2 - (x - ahead) * perMetre;
    lines.push(svg("path", { class: "grid", d: `M0 ${y.toFixed(1)}H${wide}` }));
  }
  const columns = wide / 2 / perMetre;
  for (let y = Math.ceil((left - columns) / step) * step; y <= left + columns; y += step) {
    const x = wide / 2 - (y - left) * perMetre;
    lines.push(svg("path", { class: "grid", d: `M${x.toFixed(1)} 0V${high}` }));
  }
  return lines;
}

/** @param {FramePlan} plan */
function inWords({ time, camera, obstacles }) {
  const [x = 0, y = 0, angle = 0] = camera ?? [];
  const found = obstacles.map(({ id, at: [ahead = 0, left = 0] }) => {
    const [u, v] = [ahead - x, left - y];
    const forward = u * Math.cos(angle) + v * Math.sin(angle);
    const side = v * Math.cos(angle) - u * Math.sin(angle);
    return `obstacle ${id} ${fixed(forward, 1)} m ahead and ${fixed(Math.abs(side), 1)} m to the ${side > 0 ? "left" : "right"}`;
  });
  const said = camera ? found.join(", ") || "no obstacle" : "camera position unknown";
  return `From above at ${fixed(time, 2)} s: ${said}.`;
}

customElements.define("observer-top-view", TopView);
