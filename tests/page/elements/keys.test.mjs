import assert from "node:assert/strict";
import { test } from "node:test";

import { declareKeys, declaredKeys } from "../../../static/app/elements/keys.js";

test("keys are listed by place, what works everywhere first", () => {
  declareKeys("Tabs", ["← →", "Go on"]);
  declareKeys("Driving", ["W", "Ahead"]);
  declareKeys("Everywhere", ["?", "Show"]);
  declareKeys("Tabs", ["Home", "First"]);
  assert.deepEqual(
    declaredKeys().map(([place]) => place),
    ["Everywhere", "Driving", "Tabs"],
  );
  assert.deepEqual(declaredKeys().at(-1)?.[1], [
    { keys: ["←", "→"], does: "Go on" },
    { keys: ["Home"], does: "First" },
  ]);
});
