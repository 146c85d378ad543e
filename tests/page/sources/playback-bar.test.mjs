import assert from "node:assert/strict";
import { test } from "node:test";

import "../fake-page.mjs";

const { positionInWords, shareOf } = await import("../../../static/app/sources/playback-bar.js");

test("a simulation that continues for an armed robot is not said to be beyond its end", () => {
  const told = [3, 104, 105, 213].map((frame) => positionInWords({ frame, frame_count: 105 }));
  assert.deepEqual(told, ["frame 3 / 105", "frame 104 / 105", "frame 105", "frame 213"]);
  assert.equal(shareOf({ frame: 104, frame_count: 105 }), 1);
  assert.equal(shareOf({ frame: 105, frame_count: 105 }), null);
});

test("before the first frame, and without an end, nothing is made up", () => {
  assert.equal(positionInWords({ frame: null, frame_count: 900 }), "frame – / 900");
  assert.equal(shareOf({ frame: null, frame_count: 900 }), 0);
  assert.equal(positionInWords({ frame: 7, frame_count: null }), "frame 7");
});
