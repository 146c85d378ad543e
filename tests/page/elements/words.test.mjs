import assert from "node:assert/strict";
import { test } from "node:test";

import { MOVING_MPS, OBSTACLE_COLOURS, VISIBLE_SHARE } from "../../../static/app/elements/facts.js";
import * as words from "../../../static/app/elements/words.js";
import { body, line, obstacle } from "../made.mjs";

const unseen = { of: () => null };
const QUARTER_TO_THE_RIGHT = [Math.SQRT1_2, 0, Math.SQRT1_2, 0];

test("a number that is not known is a dash, never a zero", () => {
  assert.equal(words.fixed(1.005, 1), "1.0");
  for (const unknown of [null, undefined, NaN, Infinity])
    assert.equal(words.fixed(unknown, 2), "–");
});

test("a number rounded to zero has no sign", () => {
  assert.equal(words.fixed(-0.001, 2), "0.00");
  assert.equal(words.fixed(-0.4, 0), "0");
  assert.equal(words.fixed(-0.006, 2), "−0.01");
  assert.equal(words.fixed(-10, 0), "−10");
});

test("a speed carries half of its 95 % interval where one is known", () => {
  assert.equal(words.speedWithBand({ speed: 0.5, speed_std: 0.021 }), "0.50 ± 0.04");
  assert.equal(words.speedWithBand({ speed: 0.5, speed_std: null }), "0.50");
});

test("a sentence begins large unless it begins with an address, a path or a parameter", () => {
  assert.equal(words.sentence("vision is degraded"), "Vision is degraded.");
  assert.equal(words.sentence("stop: it is armed"), "Stop: it is armed.");
  for (const spelled of [
    "simulated:webcams has no calibration.",
    "flow.window_px is too large.",
    "camera: takes two devices.",
  ])
    assert.equal(words.sentence(spelled), spelled);
});

test("a bearing is ahead up to 8 degrees and off to a side from 24 on", () => {
  const inDegrees = (/** @type {number} */ degrees) =>
    words.bearingInWords((degrees * Math.PI) / 180);
  assert.equal(inDegrees(-7.9), "ahead");
  assert.equal(inDegrees(8.1), "ahead to the right");
  assert.equal(inDegrees(-23.9), "ahead to the left");
  assert.equal(inDegrees(24.1), "off to the right");
});

test("a heading is told in the camera's axes, whichever way it looks", () => {
  const heading = (/** @type {number[] | null} */ velocity, orientation_wxyz = [1, 0, 0, 0]) =>
    words.headingInWords(obstacle({ velocity }), { position: [0, 0, 0], orientation_wxyz });
  assert.equal(heading([1, 0, 0]), "to the right");
  assert.equal(heading([-1, 0, -1]), "to the left and towards the camera");
  assert.equal(heading([0.4, 0, 1]), "away from the camera");
  assert.equal(heading([1, 0, 0], QUARTER_TO_THE_RIGHT), "away from the camera");
  assert.equal(heading([0, 0, 1], QUARTER_TO_THE_RIGHT), "to the left");
});

test("a heading is left out where it is not known or nothing moves", () => {
  const pose = line().pose;
  assert.equal(words.headingInWords(obstacle({ velocity: null }), pose), "");
  assert.equal(words.headingInWords(obstacle(), null), "");
  assert.equal(words.headingInWords(obstacle({ velocity: [0.01, 3, 0.01] }), pose), "");
});

test("the headline tells of the nearest that moves, against its truth", () => {
  const far = obstacle({ id: 2, range: 5 });
  const parked = obstacle({ id: 3, range: 1, motion: "stopped" });
  const told = words.headline(
    line({ obstacles: [far, obstacle(), parked] }),
    [body({ track_id: 1, speed: 0.48 })],
    unseen,
  );
  assert.deepEqual(told, {
    text:
      "Obstacle 1 moves at 0.50 ± 0.04 m/s to the right, 3.0 m ahead" +
      " — ground truth 0.48 m/s; one more moves",
    id: 1,
    tone: "moving",
  });
});

test("the headline says what is missed, unless it is hidden or stands", () => {
  const text = (
    /** @type {Partial<import("../../../static/app/contract").TrueBodyEntry>} */ changes,
  ) => words.headline(line(), [body(changes)], unseen).text;
  assert.equal(text({}), "No motion detected — ground truth: cart moves at 0.50 m/s.");
  assert.match(text({ visible: null }), /ground truth: cart/);
  assert.match(text({ visible: VISIBLE_SHARE }), /ground truth: cart/);
  assert.equal(text({ visible: VISIBLE_SHARE - 0.01 }), "No motion in view.");
  assert.equal(text({ speed: MOVING_MPS }), "No motion in view.");
  assert.equal(text({ role: "observer" }), "No motion in view.");
});

test("the headline says that the camera's motion is lost, and why", () => {
  const lost = line({ status: "lost", reasons: ["too dark"], obstacles: [obstacle()] });
  assert.deepEqual(words.headline(lost, [], unseen), {
    text: "Camera motion lost: too dark.",
    id: null,
    tone: "lost",
  });
});

test("durations change their unit at a minute and an hour", () => {
  const told = [0, 14.96, 59.94, 59.96, 72.3, 7512].map(words.duration);
  assert.deepEqual(told, [
    "0.0 s",
    "15.0 s",
    "59.9 s",
    "1 min 0.0 s",
    "1 min 12.3 s",
    "2 h 5 min 12.0 s",
  ]);
  assert.equal(words.duration(null), "–");
});

test("provisional numbers below zero have a track's colour too", () => {
  assert.deepEqual(
    [0, 7, 8, -1, -8].map(words.trackColour),
    [0, 7, 0, 7, 0].map((n) => `--track-${n}`),
  );
});

test("what the server says becomes one sentence", () => {
  assert.equal(words.sentence("the port is busy "), "The port is busy.");
  assert.equal(words.sentence("Really?"), "Really?");
});

test("who waves moves in place and is given no speed", () => {
  const waving = obstacle({ id: 3, motion: "in_place", range: 3.2, bearing: 0, speed: 0.04 });
  const { text, tone } = words.headline(line({ obstacles: [waving] }), [], unseen);
  assert.equal(text, "Obstacle 3 moves in place, 3.2 m ahead.");
  assert.equal(tone, "calm");
});

test("the label beside a box has no speed only where there is no motion to measure", () => {
  const label = (/** @type {Parameters<typeof obstacle>[0]} */ changes) =>
    words.boxLabel(obstacle({ speed: 0.4, speed_std: 0.05, ...changes }));
  assert.equal(label({ motion: "moving" }), "0.40 ± 0.10 m/s");
  assert.equal(label({ motion: "stopped", speed: 0.01 }), "0.01 ± 0.10 m/s");
  assert.equal(label({ motion: "in_place" }), "in place");
});

test("an age has a unit that suits it", () => {
  assert.deepEqual([0.085, 1.04, 124].map(words.age), ["85 ms", "1.0 s", "2 min 4.0 s"]);
});

test("only what is in view is said to move; a prediction is not", () => {
  const gone = obstacle({ id: 4, range: 1, state: "coasting", points: 0, speed: 1.12 });
  const seen = { of: () => ({ speed: 0.4, speed_std: 0.05, ago_s: 1.4 }) };
  const far = obstacle({ id: 2, range: 5 });
  const both = words.headline(line({ obstacles: [gone, far] }), [], seen);
  assert.equal(both.text, "Obstacle 2 moves at 0.50 ± 0.04 m/s to the right, 5.0 m ahead");
  assert.deepEqual(words.headline(line({ obstacles: [gone] }), [], seen), {
    text: "Obstacle 4 left the view 1.4 s ago, last measured at 0.40 ± 0.10 m/s.",
    id: null,
    tone: "calm",
  });
  const early = words.headline(line({ obstacles: [gone] }), [], unseen);
  assert.equal(early.text, "Obstacle 4 is out of view.");
  assert.equal(
    words.outOfViewInWords(seen.of()),
    "Out of view. Last measured at 0.40 ± 0.10 m/s, 1.4 s ago.",
  );
});

test("the state of an obstacle decides its colour, whatever its number", () => {
  const { moving, in_place, stopped, coasting } = OBSTACLE_COLOURS;
  const colour = (/** @type {Parameters<typeof obstacle>[0]} */ changes) =>
    words.stateColour(obstacle(changes));
  assert.equal(colour({ id: 1, motion: "moving" }), moving);
  assert.equal(colour({ id: 2, motion: "moving" }), moving);
  assert.equal(colour({ motion: "in_place" }), in_place);
  assert.equal(colour({ motion: "stopped" }), stopped);
  assert.equal(colour({ motion: "moving", state: "coasting" }), coasting);
});

test("durations have minutes", () => {
  assert.deepEqual([59, 65].map(words.durationInWords), ["59 s", "1 min 5 s"]);
});
