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

test("a standard deviation is shown as half of the 95 % interval, with its meaning", () => {
  const [[term, text, help] = []] = figuresOf({ speed_std_mps: 0.1 });
  assert.equal(term, "Speed, 95 % interval");
  assert.equal(text, "± 0.20 m/s");
  assert.match(String(help), /95 of 100 cases/);
});
