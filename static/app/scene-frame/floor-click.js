/** Clicks on the floor of the scene, while one is requested. */

/** @import { Frame, Ray, Vector } from "./scene-client.js" */
/** @import { FloorPlace } from "../shell/floor-pick.js" */

// A press that moves farther turns the scene; a finger is less steady than a mouse.
const STEADY_PX = { mouse: 3, other: 10 };

/**
 * Return where a ray meets the floor on which the robot stands.
 *
 * @param {Ray} ray
 * @param {Frame} base the robot: x ahead, y left, z up
 * @returns {FloorPlace | null} null: nowhere in front of the eye
 */
export function onFloor({ from, along }, { position, x, y, z }) {
  const down = dot(along, z);
  const share = dot(minus(position, from), z) / down;
  if (!Number.isFinite(share) || share <= 0) return null;
  const [fx, fy, fz] = from;
  const [ax, ay, az] = along;
  const away = minus([fx + share * ax, fy + share * ay, fz + share * az], position);
  return { ahead: dot(away, x), left: dot(away, y) };
}

/**
 * Listen for clicks, ignoring presses that turn the scene.
 *
 * @param {Window} inside the frame's window
 * @param {(x: number, y: number) => void} clicked px of the window
 */
export function listenForClicks(inside, clicked) {
  const options = { capture: true, passive: true };
  /** @type {PointerEvent | null} */
  let pressed = null;
  const steady = (/** @type {PointerEvent} */ { clientX, clientY, pointerType }) => {
    const most = pointerType === "mouse" ? STEADY_PX.mouse : STEADY_PX.other;
    return (
      pressed !== null && Math.hypot(clientX - pressed.clientX, clientY - pressed.clientY) <= most
    );
  };
  inside.addEventListener(
    "pointerdown",
    // A second finger turns or zooms, so it cancels the click.
    (event) => (pressed = event.isPrimary && event.button === 0 ? event : null),
    options,
  );
  inside.addEventListener(
    "pointermove",
    (event) => {
      if (!steady(event)) pressed = null;
    },
    options,
  );
  inside.addEventListener("pointercancel", () => (pressed = null), options);
  inside.addEventListener(
    "pointerup",
    (event) => {
      const meant = event.isPrimary && event.button === 0 && steady(event);
      pressed = null;
      if (meant) clicked(event.clientX, event.clientY);
    },
    options,
  );
}

/** @param {Vector} a @param {Vector} b */
function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** @param {Vector} a @param {Vector} b @returns {Vector} */
function minus(a, b) {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}
