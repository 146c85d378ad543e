/** The camera of the 3D scene when it follows the robot. */

/** @import { SceneFacts } from "../contract" */
/** @import { Frame, SceneClient, Vector } from "./scene-client.js" */
/** @import { CameraChoice } from "../live/scene-choice.js" */

/**
 * @typedef {object} Place of the robot on the ground of the display
 * @property {number} ahead m, from where it started
 * @property {number} left m
 * @property {number} heading rad, to the left
 */

// Time constant with which the camera lags behind.
const LAG_TIME_CONSTANT_S = 0.35;
// A larger jump means another world or a restarted source.
const JUMP_M = 2;
// Smaller movements are invisible and not drawn.
const MIN_VISIBLE_M = 0.005;
// The viewer's own keys for moving its camera.
const MOVING_KEYS = /^(Key[WASDQE]|Arrow(Up|Down|Left|Right))$/;
const DRAGGED_PX = 3;

export class SceneCamera {
  #client;
  #facts;
  /** @type {Place | null} */
  #place = null;
  #stepped = -Infinity;

  /** @type {CameraChoice} */
  choice = "free";

  /** @param {SceneClient} client @param {SceneFacts} facts */
  constructor(client, facts) {
    this.#client = client;
    this.#facts = facts;
  }

  /** Move on towards the robot; call after every drawing. @param {number} now ms */
  step(now) {
    const to = this.choice === "free" ? null : this.#robot();
    if (!to) return;
    const { place, display } = to;
    const passed_s = (now - this.#stepped) / 1000;
    this.#stepped = now;
    this.#place = this.#place ? eased(this.#place, place, passed_s) : place;
    this.#look(this.choice, this.#place, display);
  }

  /** Jump to the chosen view of the robot; for the free camera, the one from behind. */
  reset() {
    const to = this.#robot();
    this.#place = to && to.place;
    if (to) this.#look(this.choice, to.place, to.display);
  }

  #robot() {
    const display = this.#client.frame(this.#facts.display_node);
    const camera = this.#client.frame(this.#facts.camera_node);
    return display && camera ? { place: placeOf(camera, display), display } : null;
  }

  /** @param {CameraChoice} choice @param {Place} place @param {Frame} display */
  #look(choice, place, display) {
    const above = choice === "top_down";
    const { eye, look_at } = above ? this.#facts.top_down : this.#facts.follow;
    const from = above ? { ...place, heading: 0 } : place;
    const wanted = inScene(eye, from, display);
    // Compare with the actual camera, which the viewer itself may have moved, as at its start.
    if (distance(this.#client.eye() ?? wanted, wanted) > MIN_VISIBLE_M)
      this.#client.look(wanted, inScene(look_at, from, display));
  }
}

/**
 * @param {Frame} camera x right, y down, z forward
 * @param {Frame} display x ahead, y left, z up
 * @returns {Place}
 */
export function placeOf(camera, display) {
  const offset = /** @type {Vector} */ (
    camera.position.map((value, at) => value - (display.position[at] ?? 0))
  );
  return {
    ahead: dot(offset, display.x),
    left: dot(offset, display.y),
    heading: Math.atan2(dot(camera.z, display.y), dot(camera.z, display.x)),
  };
}

/**
 * @param {Vector} point ahead, left and up of a place, m
 * @param {Place} place
 * @param {Frame} display
 * @returns {Vector} in the renderer's axes
 */
export function inScene(point, place, display) {
  const [cos, sin] = [Math.cos(place.heading), Math.sin(place.heading)];
  const ahead = place.ahead + point[0] * cos - point[1] * sin;
  const left = place.left + point[0] * sin + point[1] * cos;
  const along = (/** @type {0 | 1 | 2} */ at) =>
    display.position[at] + ahead * display.x[at] + left * display.y[at] + point[2] * display.z[at];
  return [along(0), along(1), along(2)];
}

/**
 * @param {Place} from
 * @param {Place} to
 * @param {number} passed_s
 * @returns {Place} between them, turning the shorter way
 */
export function eased(from, to, passed_s) {
  if (Math.hypot(to.ahead - from.ahead, to.left - from.left) > JUMP_M) return to;
  const share = 1 - Math.exp(-passed_s / LAG_TIME_CONSTANT_S);
  const turn = to.heading - from.heading;
  return {
    ahead: from.ahead + share * (to.ahead - from.ahead),
    left: from.left + share * (to.left - from.left),
    heading: from.heading + share * Math.atan2(Math.sin(turn), Math.cos(turn)),
  };
}

/**
 * Notice when the user moves the viewer's camera.
 *
 * @param {Window} inside the frame's window
 * @param {() => void} taken
 */
export function onUserMove(inside, taken) {
  const options = { capture: true, passive: true };
  let pressed = { x: 0, y: 0 };
  inside.addEventListener("wheel", taken, options);
  inside.addEventListener(
    "pointerdown",
    (event) => (pressed = { x: event.clientX, y: event.clientY }),
    options,
  );
  inside.addEventListener(
    "pointermove",
    ({ buttons, clientX, clientY }) => {
      const moved = Math.hypot(clientX - pressed.x, clientY - pressed.y);
      if (buttons !== 0 && moved > DRAGGED_PX) taken();
    },
    options,
  );
  inside.addEventListener(
    "keydown",
    ({ code }) => {
      if (MOVING_KEYS.test(code)) taken();
    },
    options,
  );
}

/** @param {Vector} a @param {Vector} b */
function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** @param {Vector} a @param {Vector} b */
function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
