import assert from "node:assert/strict";
import { test } from "node:test";

import * as words from "../../../static/app/runs/methods-words.js";
import { placeOf } from "../../../static/app/runs/run-words.js";
import { run } from "../made.mjs";

/** @import { FrameCounts, FrameEntry, FrameObstacle, RunFrames } from "../../../static/app/contract" */

/** @param {Partial<FrameObstacle>} [changes] @returns {FrameObstacle} */
const obstacle = (changes) => ({
  id: 1,
  state: "confirmed",
  motion: "moving",
  speed: 0.5,
  speed_std: null,
  box_px: [0, 0, 10, 10],
  arrow_px: null,
  silhouette: null,
  false: false,
  ...changes,
});

/**
 * @param {number} frame
 * @param {FrameObstacle[]} obstacles
 * @param {FrameCounts | null} counts
 * @returns {FrameEntry}
 */
const entry = (frame, obstacles, counts) => ({
  frame,
  time: frame / 15,
  status: "ok",
  obstacles,
  truth: [],
  counts,
  observed_ms: 12,
  plan: {
    time: frame / 15,
    segment: 0,
    camera: null,
    obstacles: [],
    truth: [],
    goal: null,
    path: [],
  },
  goal: null,
});

/** @param {FrameEntry[]} frames @returns {RunFrames} */
const found = (frames) => ({
  width: 512,
  height: 256,
  frames,
  first: 0,
  every: 1,
  count: frames.length,
  truth: frames.some(({ counts }) => counts !== null),
  observed_ms: 41.4,
  maps: [],
});

/** @param {number} wrong @param {number | null} error @returns {FrameCounts} */
const counts = (wrong, error) => ({ false: wrong, found: 9, missed: 3, velocity_rmse_mps: error });

/** @param {FrameCounts | null} first @param {FrameCounts | null} second */
function concluded(first, second) {
  return words.conclusion(
    [first, second].map((end, at) => ({
      run: run(),
      name: ["paper", "default"][at] ?? "",
      found: found([entry(0, [], end), entry(1, [obstacle()], end)]),
    })),
  );
}

test("what came of it is told in two sentences", () => {
  assert.equal(
    concluded(counts(43, 0.214), counts(0, 0.05)),
    "On these 2 frames, paper reported 43 false obstacles, default none. " +
      "Velocity error: 0.21 m/s with paper, 0.05 m/s with default.",
  );
  assert.equal(
    concluded(counts(1, null), counts(2, 0.05)),
    "On these 2 frames, paper reported 1 false obstacle, default 2. " +
      "Velocity error: 0.05 m/s with default.",
  );
});

test("without ground truth nothing is called false", () => {
  assert.equal(
    concluded(null, null),
    "On these 2 frames, paper reported obstacles in 1 frame, default reported obstacles in 1 " +
      "frame. False obstacles and errors can only be counted with ground truth.",
  );
  assert.equal(words.conclusion([]), "There are no frames to compare.");
});

test("the figures are those up to the frame that is shown", () => {
  const both = found([
    entry(0, [], counts(0, null)),
    entry(1, [obstacle({ false: true })], {
      false: 1,
      found: 1,
      missed: 0,
      velocity_rmse_mps: 0.3,
    }),
  ]);
  const texts = (/** @type {number} */ at) => words.figuresAt(both, at).map(([, text]) => text);
  assert.deepEqual(texts(0), ["0", "9 of 12", "–", "41 ms"]);
  assert.deepEqual(texts(1), ["1", "1 of 1", "0.30 m/s", "41 ms"]);
  const bare = found([entry(0, [obstacle()], null), entry(1, [obstacle(), obstacle()], null)]);
  assert.deepEqual(
    words.figuresAt(bare, 1).map(([name, text]) => `${name}: ${text}`),
    ["Obstacles now: 2", "Obstacles so far: 3", "Time per frame: 41 ms"],
  );
});

test("runs of other frames do not go side by side", () => {
  const first = found([entry(0, [], null), entry(1, [], null)]);
  assert.ok(words.sameFrames([first, found([entry(0, [obstacle()], null), entry(1, [], null)])]));
  assert.ok(!words.sameFrames([first, found([entry(0, [], null)])]));
  assert.ok(!words.sameFrames([first, found([entry(1, [], null), entry(2, [], null)])]));
});

test("a method is called by its preset, or by its run where that tells more", () => {
  assert.deepEqual(words.methodNames([run({ preset: "paper" }), run({ preset: null })]), [
    "paper",
    "custom values",
  ]);
  assert.deepEqual(
    words.methodNames([run({ preset: "paper", name: "a" }), run({ preset: "paper", name: "b" })]),
    ["a", "b"],
  );
});

test("the page's address names the runs and the frame", () => {
  assert.equal(words.methodsHref(["a", "b c"], 7), "#methods/a,b%20c/7");
  assert.deepEqual(placeOf("#methods/a,b%20c/7"), { view: "methods", ids: ["a", "b c"] });
  assert.deepEqual(placeOf("#methods"), { view: "methods", ids: [] });
  assert.deepEqual(placeOf("#methods/a"), { view: "methods", ids: [] });
  assert.equal(words.positionOf("#methods/a,b%20c/7"), 7);
  assert.equal(words.positionOf("#methods/a,b"), null);
  assert.equal(words.positionOf("#runs/7"), null);
});

test("a picture is told to who does not see it", () => {
  const results = words.findingsInWords(
    "paper",
    entry(3, [obstacle({ false: true }), obstacle({ id: 2, motion: "stopped" })], counts(1, null)),
  );
  assert.equal(results, "paper: 2 obstacles; moving: 1 at 0.50 m/s; 1 false");
});

test("the time left follows from the pace since the comparison was first seen", () => {
  const began = { at: 1000, share: 0.1 };
  assert.equal(words.timeLeft(began, { at: 3000, share: 0.2 }), "");
  assert.equal(words.timeLeft(began, { at: 11_000, share: 0.1 }), "");
  assert.equal(words.timeLeft(began, { at: 11_000, share: 0.3 }), "about 35 s left");
  assert.equal(words.timeLeft(began, { at: 11_000, share: 0.2 }), "about 1 min 20 s left");
  assert.equal(words.timeLeft(began, { at: 11_000, share: 1 }), "about 5 s left");
});
