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
      camera: { position: { x: 1, y: 2, z: 3 } },
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

test("a viewer that has not started, or is another one, is left alone", () => {
  const client = new SceneClient(/** @type {any} */ ({}));
  assert.equal(client.shows("/display"), null);
  assert.equal(client.frame("/display"), null);
  assert.equal(client.eye(), null);
  client.show("/display", false);
  client.look([0, 0, 0], [1, 1, 1]);
});
