import assert from "node:assert/strict";
import { test } from "node:test";

import { paceWarning } from "../../../static/app/shell/pace-words.js";

/** @typedef {Parameters<typeof paceWarning>[0]} Facts */

/** @param {object} playback @param {number} [seen] frames per second @param {object | null} [live] */
function facts(playback, seen = 15, live = null) {
  const source = { spec: "simulated:lab", frame_rate: 15 };
  const rates = { unique_frames_per_s: seen };
  return /** @type {Facts} */ (/** @type {unknown} */ ({ playback, live, source, rates }));
}

test("a source that plays slower than asked for is told, with its rate", () => {
  const playing = { rate: 1, achieved_rate: 0.4, paused: false, ended: false };
  assert.equal(paceWarning(facts(playing)), "this computer is too slow: 0.4 × real time");
  const faster = paceWarning(facts({ ...playing, rate: 4, achieved_rate: 2.1 }));
  assert.equal(faster, "this computer is too slow: 2.1 × real time, 4 × requested");
});

test("nothing is told while it keeps up, pauses, has ended or was not measured", () => {
  const playing = { rate: 1, achieved_rate: 0.97, paused: false, ended: false };
  for (const other of [
    {},
    { achieved_rate: 0, paused: true },
    { achieved_rate: 0.2, paused: true },
    { achieved_rate: 0.2, ended: true },
    { achieved_rate: null },
  ])
    assert.equal(paceWarning(facts({ ...playing, ...other })), "");
});

test("cameras are told by the frames that were seen of those they send", () => {
  const cameras = { trouble: null };
  assert.equal(paceWarning(facts({}, 6.2, cameras)), "this computer is too slow: 6.2 of 15 fps");
  assert.equal(paceWarning(facts({}, 14.2, cameras)), "");
});

test("reduced processing is told, whether or not it lets all frames through", () => {
  const cameras = { trouble: null, reduced_to: "points every 25 px" };
  assert.equal(
    paceWarning(facts({}, 6.2, cameras)),
    "this computer is too slow: 6.2 of 15 fps, reduced to points every 25 px",
  );
  assert.equal(
    paceWarning(facts({}, 15, cameras)),
    "this computer is too slow for full processing: reduced to points every 25 px",
  );
});
