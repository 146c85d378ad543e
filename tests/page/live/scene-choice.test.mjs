import assert from "node:assert/strict";
import { test } from "node:test";

import { SceneChoice } from "../../../static/app/live/scene-choice.js";

/** @param {string | null} [kept] */
function storeOf(kept = null) {
  return {
    kept,
    getItem() {
      return this.kept;
    },
    /** @param {string} _ @param {string} value */
    setItem(_, value) {
      this.kept = value;
    },
  };
}

test("everything is shown, and the camera is the person's, until something else was chosen", () => {
  const choice = new SceneChoice(storeOf());
  assert.ok(choice.shows("cloud"));
  assert.equal(choice.camera, "free");
});

test("a choice is told, and remembered", () => {
  const store = storeOf();
  const choice = new SceneChoice(store);
  let told = 0;
  choice.addEventListener("changed", () => (told += 1));
  choice.show("cloud", false);
  choice.show("truth", false);
  choice.show("truth", true);
  choice.camera = "top_down";
  choice.camera = "top_down";
  assert.equal(told, 4);
  const again = new SceneChoice(store);
  assert.deepEqual(
    ["cloud", "truth", "boxes"].map((layer) => again.shows(layer)),
    [false, true, true],
  );
  assert.equal(again.camera, "top_down");
});

test("whatever else is in its place is nothing", () => {
  for (const kept of ["", "{", "7", "null", "[]", '{"hidden": 3, "camera": "constructor"}']) {
    const choice = new SceneChoice(storeOf(kept));
    assert.ok(choice.shows("cloud"), kept);
    assert.equal(choice.camera, "free");
  }
});
