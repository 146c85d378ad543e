import assert from "node:assert/strict";
import { test } from "node:test";

import { SceneClient } from "../../../static/app/scene-frame/scene-client.js";

function viewer() {
  let asked = 0;
  const inside = {
    __viserMutable: {
      messageQueue: /** @type {any[]} */ ([]),
      requestRender: () => (asked += 1),
      nodeRefFromName: {
        "/display": {
          matrixWorld: {
            elements: [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 7, 8, 9, 1],
          },
        },
      },
      canvas: { getBoundingClientRect: () => ({ left: 100, top: 50, width: 400, height: 200 }) },
      // Vertical field of view 90 degrees, aspect 2 : 1; a quarter turn to the left, 2 m up.
      camera: {
        position: { x: 1, y: 2, z: 3 },
        matrixWorld: { elements: [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 1, 2, 3, 1] },
        projectionMatrixInverse: {
          elements: [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, -4.995, 0, 0, -1, 5.005],
        },
      },
      cameraControl: null,
    },
    __viserSceneTree: {
      getState: () => ({
        "/display": {},
        "/display/cloud": { visibility: false },
      }),
    },
  };
  return {
    client: new SceneClient(/** @type {any} */ (inside)),
    inside,
    asked: () => asked,
  };
}

test("a node is hidden by a message as the server sends it, and drawn anew", () => {
  const { client, inside, asked } = viewer();
  assert.deepEqual(
    ["/display", "/display/cloud", "/none"].map((node) => client.shows(node)),
    [true, false, null],
  );
  client.show("/display", false);
  client.show("/none", false);
  assert.deepEqual(inside.__viserMutable.messageQueue, [
    {
      type: "SetSceneNodeVisibilityMessage",
      name: "/display",
      owner: "",
      visible: false,
    },
  ]);
  assert.equal(asked(), 1);
});

test("places are read by columns", () => {
  const { client } = viewer();
  assert.deepEqual(client.frame("/display"), {
    position: [7, 8, 9],
    x: [1, 0, 0],
    y: [0, 0, -1],
    z: [0, 1, 0],
  });
  assert.equal(client.frame("/none"), null);
  assert.deepEqual(client.eye(), [1, 2, 3]);
});

test("what a place of the window shows is a ray from the eye", () => {
  const { client } = viewer();
  /** @param {number} x @param {number} y */
  const direction = (x, y) => {
    const ray = client.ray(x, y);
    assert.ok(ray);
    assert.deepEqual(ray.from, [1, 2, 3]);
    const longest = Math.max(...ray.along.map(Math.abs));
    return ray.along.map((value) => Math.round((1000 * value) / longest) / 1000 + 0);
  };
  assert.deepEqual(direction(300, 150), [-1, 0, 0]);
  // The lower edge and the right one.
  assert.deepEqual(direction(300, 250), [-1, -1, 0]);
  assert.deepEqual(direction(500, 150), [-0.5, 0, -1]);
});

test("a viewer that has not started, or is another one, is left alone", () => {
  const client = new SceneClient(/** @type {any} */ ({}));
  assert.equal(client.shows("/display"), null);
  assert.equal(client.frame("/display"), null);
  assert.equal(client.eye(), null);
  assert.equal(client.ray(1, 1), null);
  client.show("/display", false);
  client.look([0, 0, 0], [1, 1, 1]);
});
