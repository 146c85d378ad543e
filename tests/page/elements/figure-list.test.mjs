import assert from "node:assert/strict";
import { test } from "node:test";

import { figuresOf } from "../../../static/app/elements/figure-list.js";

test("figures stand in the order of importance, with unit, unknown ones in words", () => {
  assert.deepEqual(figuresOf({ odd_one: 1, depth_m: null, speed_mps: 0.456, matches: 12 }), [
    ["Speed", "0.46 m/s"],
    ["Depth", "unknown"],
    ["Matches", "12"],
    ["odd one", "1.00"],
  ]);
});
