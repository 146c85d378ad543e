import assert from "node:assert/strict";
import { test } from "node:test";

import { BoundedMap } from "../../../static/app/elements/bounded-map.js";

test("the oldest entries go, and are told of", () => {
  /** @type {[string, number][]} */
  const dropped = [];
  const map = new BoundedMap(2, (key, value) => dropped.push([key, value]));
  map.set("a", 1).set("b", 2).set("c", 3);
  assert.deepEqual([...map.keys()], ["b", "c"]);
  assert.deepEqual(dropped, [["a", 1]]);
});

test("what is set anew is the newest; what is deleted is not told of", () => {
  /** @type {string[]} */
  const dropped = [];
  const map = new BoundedMap(2, (key) => dropped.push(key));
  map.set("a", 1).set("b", 2);
  map.delete("a");
  map.set("a", 1).set("c", 3);
  assert.deepEqual([...map.keys()], ["a", "c"]);
  assert.deepEqual(dropped, ["b"]);
});
