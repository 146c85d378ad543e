import assert from "node:assert/strict";
import { test } from "node:test";

import {
  SceneCamera,
  eased,
  inScene,
  placeOf,
} from "../../../static/app/scene-frame/scene-camera.js";

/** @import { Frame, SceneClient, Vector } from "../../../static/app/scene-frame/scene-client.js" */

// The renderer has y up; the display has z up and is offset by 4 m.
/** @type {Frame} */
const DISPLAY = {
  position: [-4, 0, 0],
  x: [1, 0, 0],
  y: [0, 0, -1],
  z: [0, 1, 0],
};
/** @type {any} */
const FACTS = {
  layers: [],
  display_node: "/display",
  camera_node: "/camera",
  follow: { eye: [-1.6, 1, 1.5], look_at: [2.3, -0.1, 0.25] },
  top_down: { eye: [1.99, 0, 7.5], look_at: [2, 0, 0] },
};

/**
 * A camera at a place of the display, 0.4 m high, looking down by 0.3 rad.
 *
 * @param {number} ahead @param {number} left @param {number} heading
 * @returns {Frame}
 */
function cameraAt(ahead, left, heading) {
  const place = { ahead, left, heading };
  const position = inScene([0, 0, 0.4], place, DISPLAY);
  const tip = inScene([Math.cos(0.3), 0, 0.4 - Math.sin(0.3)], place, DISPLAY);
  const z = /** @type {Vector} */ (tip.map((value, at) => value - (position[at] ?? 0)));
  return { position, x: [0, 0, 0], y: [0, 0, 0], z };
}

/** @param {readonly number[]} actual @param {readonly number[]} expected */
function assertClose(actual, expected) {
  assert.equal(actual.length, expected.length);
  for (const [at, value] of expected.entries())
    assert.ok(Math.abs((actual[at] ?? NaN) - value) < 1e-9, `${actual} is not ${expected}`);
}

class FakeClient {
  /** @type {Frame | null} */
  camera = cameraAt(0, 0, 0);
  /** @type {Vector} */
  at = [3, 3, 3];
  /** @type {Vector[][]} */
  looks = [];

  /** @param {string} node */
  frame(node) {
    return node === "/display" ? DISPLAY : this.camera;
  }

  eye() {
    return this.at;
  }

  /** @param {Vector} eye @param {Vector} target */
  look(eye, target) {
    this.at = eye;
    this.looks.push([eye, target]);
  }
}

function followed() {
  const client = new FakeClient();
  const camera = new SceneCamera(/** @type {SceneClient} */ (/** @type {any} */ (client)), FACTS);
  return { client, camera };
}

test("the robot's place is read on the ground, however the camera is tilted", () => {
  const { ahead, left, heading } = placeOf(cameraAt(1.5, -0.5, 2.1), DISPLAY);
  assertClose([ahead, left, heading], [1.5, -0.5, 2.1]);
});

test("the eye goes behind the robot and turns with it", () => {
  const { client, camera } = followed();
  camera.choice = "follow";
  camera.step(0);
  assertClose(client.looks[0]?.flat() ?? [], [-5.6, 1.5, -1, -1.7, 0.25, 0.1]);
  client.camera = cameraAt(1, 0, Math.PI / 2);
  camera.reset();
  // "Behind" is now to the right of the start, and the eye's left is behind.
  assertClose(client.at, [-4, 1.5, 1.6]);
});

test("from above the first heading stays at the top", () => {
  const { client, camera } = followed();
  client.camera = cameraAt(1, 0.5, Math.PI / 2);
  camera.choice = "top_down";
  camera.step(0);
  assertClose(client.looks[0]?.flat() ?? [], [-1.01, 7.5, -0.5, -1, 0, -0.5]);
});

test("nothing is asked of a viewer whose camera is where it should be, or is the person's", () => {
  const { client, camera } = followed();
  camera.step(0);
  assert.equal(client.looks.length, 0);
  camera.choice = "follow";
  for (let now = 0; now < 10_000; now += 100) camera.step(now);
  assert.equal(client.looks.length, 1);
  // As the viewer does once when the first messages arrive.
  client.at = [0, 0, 0];
  camera.step(10_100);
  assert.equal(client.looks.length, 2);
  client.camera = null;
  camera.step(10_200);
  camera.reset();
  assert.equal(client.looks.length, 2);
});

test("it follows smoothly, and arrives", () => {
  const { client, camera } = followed();
  camera.choice = "follow";
  camera.step(0);
  client.camera = cameraAt(0.5, 0, 0);
  let [before = NaN] = client.at;
  for (let now = 100; now < 4000; now += 100) {
    camera.step(now);
    const [after] = client.at;
    assert.ok(after >= before && after - before < 0.2);
    before = after;
  }
  assert.ok(Math.abs(before - -5.1) < 0.01);
});

test("turns go the shorter way, and another world is no way", () => {
  const from = { ahead: 0, left: 0, heading: 3 };
  const { heading } = eased(from, { ahead: 0, left: 0, heading: -3 }, 0.1);
  assert.ok(heading > 3 && heading < 3.2);
  const far = { ahead: 5, left: 0, heading: 0 };
  assert.deepEqual(eased(from, far, 0.001), far);
});

test("the view behind the robot is given back where the camera is the person's", () => {
  const { client, camera } = followed();
  client.camera = cameraAt(1, 0, 0);
  camera.reset();
  assertClose(client.at, [-4.6, 1.5, -1]);
  camera.step(0);
  assert.equal(client.looks.length, 1);
});
