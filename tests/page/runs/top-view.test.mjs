import assert from "node:assert/strict";
import { test } from "node:test";

import { boundsOf, gridOf } from "../../../static/app/runs/top-view-bounds.js";
import { frameAt } from "../../../static/app/runs/run-words.js";

/** @import { FrameEntry } from "../../../static/app/contract" */

/**
 * @param {number} time
 * @param {[number, number]} camera ahead, left
 * @param {[number, number][]} obstacles
 * @returns {FrameEntry}
 */
function frame(time, camera, obstacles = []) {
  return {
    frame: 0,
    time,
    status: "ok",
    obstacles: [],
    truth: [],
    counts: null,
    observed_ms: null,
    plan: {
      time,
      segment: 0,
      camera: [...camera, 0],
      obstacles: obstacles.map((at, id) => ({
        id,
        state: "confirmed",
        motion: "moving",
        at,
        velocity: null,
        ellipse: null,
      })),
      truth: [],
      goal: null,
      path: [],
    },
    goal: null,
  };
}

test("the frame nearest to a time is found, before, between and behind them", () => {
  const frames = [1, 1.1, 1.2, 1.6].map((time) => frame(time, [0, 0]));
  const found = [0, 1.04, 1.06, 1.2, 1.39, 1.41, 9].map((time) => frameAt(frames, time));
  assert.deepEqual(found, [0, 0, 1, 2, 2, 3, 3]);
  assert.equal(frameAt(frames.slice(0, 1), 5), 0);
});

test("a top view holds the camera's way and what was found, to one scale", () => {
  const frames = [frame(0, [0, 0], [[6, 1]]), frame(1, [2, 0], [[6, -3]])];
  const { ahead, left, perMetre } = boundsOf(frames, 452, 252);
  assert.deepEqual([ahead, left], [3, -1]);
  // 6 m ahead in 200 px set the scale; 4 m across would have more room.
  assert.ok(Math.abs(perMetre - 200 / 6) < 1e-9);
});

test("a top view holds the goal that the observer drives to", () => {
  const there = frame(1, [1, 0]);
  there.plan.goal = [7, 2];
  const { ahead, left } = boundsOf([frame(0, [0, 0]), there], 400, 400);
  assert.deepEqual([ahead, left], [3.5, 1]);
});

test("a stray far away does not shrink all else, and a camera that stands has some room", () => {
  const near = Array.from({ length: 200 }, (_, k) => frame(k, [0, 0], [[3, 0]]));
  const { ahead } = boundsOf([...near, frame(200, [0, 0], [[90, 0]])], 400, 400);
  assert.equal(ahead, 1.5);
  assert.ok(boundsOf([frame(0, [0, 0])], 400, 400).perMetre <= 400 / 3);
  const lost = frame(0, [0, 0]);
  lost.plan.camera = null;
  assert.ok(Number.isFinite(boundsOf([lost], 400, 400).perMetre));
});

test("the grid's lines stand far enough apart", () => {
  assert.deepEqual([200, 30, 10, 0.1].map(gridOf), [0.5, 2, 5, 100]);
});
