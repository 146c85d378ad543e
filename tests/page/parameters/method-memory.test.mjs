import assert from "node:assert/strict";
import { test } from "node:test";

import { MethodMemory } from "../../../static/app/parameters/method-memory.js";

/** @param {string | null} [kept] */
function storage(kept = null) {
  return {
    getItem: () => kept,
    setItem: (/** @type {string} */ _, /** @type {string} */ value) => void (kept = value),
  };
}

test("what a method was left with is kept over a reload", () => {
  const kept = storage();
  const left = { basedOn: "mine", values: { "a.x": 3 } };
  new MethodMemory(kept).remember("paper", left);
  const again = new MethodMemory(kept);
  assert.deepEqual(again.recall("paper"), left);
  assert.equal(again.recall("default"), null);
  again.remember("paper", null);
  assert.equal(new MethodMemory(kept).recall("paper"), null);
});

test("what was damaged is left out", () => {
  for (const damaged of ["{", "null", "5", '{"paper": 1}', '{"paper": {"basedOn": "mine"}}'])
    assert.equal(new MethodMemory(storage(damaged)).recall("paper"), null, damaged);
});
