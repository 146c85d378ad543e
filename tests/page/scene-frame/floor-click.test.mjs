import assert from "node:assert/strict";
import { test } from "node:test";

import { listenForClicks, onFloor } from "../../../static/app/scene-frame/floor-click.js";

/** @import { Frame, Vector } from "../../../static/app/scene-frame/scene-client.js" */

/**
 * A robot in a renderer with y up, turned left by an angle.
 *
 * @param {Vector} position @param {number} heading rad
 * @returns {Frame}
 */
function robotAt(position, heading) {
  const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
  return { position, x: [cos, 0, -sin], y: [-sin, 0, -cos], z: [0, 1, 0] };
}

/** @param {{ahead: number, left: number} | null} place @param {number} ahead @param {number} left */
function assertPlace(place, ahead, left) {
  assert.ok(place);
  assert.ok(Math.abs(place.ahead - ahead) < 1e-9, `${place.ahead} ahead`);
  assert.ok(Math.abs(place.left - left) < 1e-9, `${place.left} to the left`);
}

test("a click is where its ray meets the floor, seen from the robot", () => {
  const straight = robotAt([0, 0, 0], 0);
  assertPlace(onFloor({ from: [2, 5, -1], along: [0, -0.5, 0] }, straight), 2, 1);
  assertPlace(onFloor({ from: [0, 2, 0], along: [1, -1, 0] }, straight), 2, 0);
  // After a quarter turn to the left, what was on the left is ahead.
  const turned = robotAt([1, 0, 0], Math.PI / 2);
  assertPlace(onFloor({ from: [1, 3, -2], along: [0, -1, 0] }, turned), 2, 0);
  assertPlace(onFloor({ from: [3, 3, 0], along: [0, -1, 0] }, turned), 0, -2);
});

test("on a floor that is drawn askew the place is still the robot's", () => {
  const { cos, sin } = { cos: Math.cos(0.1), sin: Math.sin(0.1) };
  /** @type {Frame} */
  const tilted = { position: [0, 1, 0], x: [cos, sin, 0], y: [0, 0, -1], z: [-sin, cos, 0] };
  /** @type {Vector} */
  const eye = [0, 4, 2];
  /** @type {Vector} */
  const shown = [3 * cos, 1 + 3 * sin, -0.5];
  const along = /** @type {Vector} */ (shown.map((value, at) => value - (eye[at] ?? 0)));
  assertPlace(onFloor({ from: eye, along }, tilted), 3, 0.5);
});

test("above the horizon there is no floor", () => {
  const robot = robotAt([0, 0, 0], 0);
  assert.equal(onFloor({ from: [0, 2, 0], along: [1, 0.1, 0] }, robot), null);
  assert.equal(onFloor({ from: [0, 2, 0], along: [1, 0, 0] }, robot), null);
});

/** @param {string} type @param {number} x @param {object} [more] */
function pointer(type, x, more) {
  const event = new Event(type);
  const told = { clientX: x, clientY: 20, isPrimary: true, button: 0, pointerType: "mouse" };
  return Object.assign(event, told, more);
}

function listened() {
  const inside = new EventTarget();
  /** @type {number[]} */
  const clicks = [];
  listenForClicks(/** @type {any} */ (inside), (x) => clicks.push(x));
  return { inside, clicks };
}

test("a press that stays is a click, one that turns the scene is not", () => {
  const { inside, clicks } = listened();
  const send = (/** @type {Event[]} */ ...events) =>
    events.forEach((event) => inside.dispatchEvent(event));
  send(pointer("pointerdown", 10), pointer("pointermove", 12), pointer("pointerup", 12));
  assert.deepEqual(clicks, [12]);
  // Even if it comes back.
  send(pointer("pointerdown", 10), pointer("pointermove", 90), pointer("pointerup", 10));
  send(pointer("pointerdown", 10, { button: 2 }), pointer("pointerup", 10, { button: 2 }));
  send(pointer("pointerdown", 10), pointer("pointercancel", 10), pointer("pointerup", 10));
  send(pointer("pointerup", 10));
  assert.deepEqual(clicks, [12]);
});

test("a finger may be less steady, and a second one is no click", () => {
  const { inside, clicks } = listened();
  const finger = { pointerType: "touch" };
  const other = { pointerType: "touch", isPrimary: false };
  inside.dispatchEvent(pointer("pointerdown", 10, finger));
  inside.dispatchEvent(pointer("pointerup", 17, finger));
  assert.deepEqual(clicks, [17]);
  inside.dispatchEvent(pointer("pointerdown", 10, finger));
  inside.dispatchEvent(pointer("pointerdown", 80, other));
  inside.dispatchEvent(pointer("pointerup", 10, finger));
  assert.deepEqual(clicks, [17]);
});
