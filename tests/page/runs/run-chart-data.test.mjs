import assert from "node:assert/strict";
import { test } from "node:test";

import * as data from "../../../static/app/runs/run-chart-data.js";
import { run } from "../made.mjs";

/** @import { ChartCurve, RunChart } from "../../../static/app/contract" */

/** @param {number[]} times @param {Partial<ChartCurve>} [changes] @returns {ChartCurve} */
function track(times, changes) {
  return {
    kind: "estimate",
    label: "",
    role: "obstacle",
    track_id: 1,
    body: null,
    segment: 0,
    times,
    speeds: times.map(() => 0.5),
    stds: times.map(() => 0.02),
    ...changes,
  };
}

/** @param {number[]} times @param {Partial<ChartCurve>} [changes] */
const truth = (times, changes) =>
  track(times, { kind: "truth", label: "cart", track_id: null, stds: null, ...changes });

/** @param {ChartCurve[]} curves @param {Partial<RunChart>} [changes] @returns {RunChart} */
function chart(curves, changes) {
  return {
    run: run(),
    aligned: false,
    sentence: null,
    alignment: null,
    choices: null,
    curves,
    changes: [],
    errors: [],
    ...changes,
  };
}

/** @param {RunChart[]} charts @param {boolean} overlaid */
function onlyPanel(charts, overlaid) {
  const [panel, ...others] = data.panelsOf(charts, overlaid);
  assert.equal(others.length, 0);
  assert.ok(panel);
  return panel;
}

test("tracks of one colour that follow each other are one curve with their own names", () => {
  const { curves } = onlyPanel(
    [chart([track([0, 1]), track([3, 4], { track_id: 9 }), track([3.5, 4], { track_id: 17 })])],
    false,
  );
  const [first, second] = curves;
  assert.equal(curves.length, 2);
  assert.deepEqual(first?.times, [0, 1, 2, 3, 4]);
  assert.deepEqual(first?.speeds, [0.5, 0.5, null, 0.5, 0.5]);
  assert.deepEqual(
    first?.parts.map(({ label }) => label),
    ["Obstacle 1", "Obstacle 9"],
  );
  assert.deepEqual(second?.times, [3.5, 4]);
});

test("beside tracks of a body those without one are strays, and truth lies on top", () => {
  const { curves } = onlyPanel(
    [chart([track([0, 1], { body: "cart" }), track([0, 1], { track_id: 2 }), truth([0, 1])])],
    false,
  );
  assert.deepEqual(
    curves.map(({ choice, kind, banded }) => [choice, kind, banded]),
    [
      ["stray", "stray", false],
      ["matched", "estimate", true],
      ["truth", "truth", false],
    ],
  );
});

test("no line is drawn over a stretch of more than three usual steps", () => {
  const { curves, gaps } = onlyPanel([chart([truth([0, 1, 2, 3, 4, 8])])], false);
  assert.deepEqual(curves[0]?.times, [0, 1, 2, 3, 4, 6, 8]);
  assert.equal(curves[0]?.speeds[5], null);
  assert.deepEqual(gaps, [{ begin: 4, end: 8, run: "first" }]);
});

test("only tracks of five samples and more begin with their number", () => {
  const long = track([0, 1, 2, 3, 4], { speeds: [null, 0.7, 0.5, 0.5, 0.5] });
  const { starts } = onlyPanel([chart([long, track([0, 1], { track_id: 2 })])], false);
  assert.deepEqual(
    starts.map(({ time, speed, words }) => [time, speed, words]),
    [[1, 0.7, "1"]],
  );
});

test("runs of other recordings begin at zero, a run and its re-run keep one clock", () => {
  const first = chart([track([10, 11])]);
  const other = chart([track([50, 51])], { run: run({ id: "r2" }) });
  const again = chart([track([10.5, 11])], { run: run({ id: "r3", rerun_of: "r1" }) });
  assert.deepEqual(data.originsOf([first, other]), [10, 50]);
  assert.deepEqual(data.originsOf([first, again]), [0, 0]);
  assert.equal(data.sameRecording([other, again]), false);
});

test("over each other, what a run and its re-run share is drawn once", () => {
  const first = chart([track([0, 1]), truth([0, 1])]);
  const again = chart([track([0, 1]), truth([0, 1])], {
    run: run({ id: "r3", name: "again", rerun_of: "r1" }),
  });
  const { curves, title } = onlyPanel([first, again], true);
  assert.equal(title, "first and again");
  assert.deepEqual(
    curves.map(({ label, colour }) => [label, colour]),
    [
      ["first: Obstacle 1", "--track-0"],
      ["again: Obstacle 1", "--track-1"],
      ["Ground truth cart", "--text"],
    ],
  );
});

test("a change of identity is told by track, without its segment", () => {
  const changes = [{ time: 12, body: "cart", before: "0:3", after: "1:4" }];
  const { changes: told } = onlyPanel([chart([track([10, 14])], { changes })], false);
  assert.deepEqual(
    told.map(({ time, words, body }) => [time, words, body]),
    [[12, "3 → 4", "cart"]],
  );
});

test("a reading carries the name of the track that was measured then", () => {
  const { curves } = onlyPanel([chart([track([0, 1]), track([3, 4], { track_id: 9 })])], false);
  const labels = (/** @type {number} */ time) =>
    data.readingsAt(curves, time, 0.2).map(({ label }) => label);
  assert.deepEqual(labels(0.9), ["Obstacle 1"]);
  assert.deepEqual(labels(2), []);
  assert.deepEqual(labels(3.1), ["Obstacle 9"]);
});

test("the extent is the whole run, or that of all curves where its length is unknown", () => {
  const known = { run: run({ begin_s: 0.5, duration_s: 15 }) };
  assert.deepEqual(data.extentOf([chart([track([2, 3])], known)]), [0.5, 15.5]);
  assert.deepEqual(data.extentOf([chart([track([2, 3]), truth([1, 2])])]), [1, 3]);
  assert.deepEqual(data.extentOf([chart([])]), [0, 1]);
});

test("runs of several recordings begin together and end when they end", () => {
  const first = chart([track([12, 13])], { run: run({ begin_s: 10, duration_s: 4 }) });
  const other = chart([track([50, 51])], { run: run({ id: "r2", begin_s: 50, duration_s: 9 }) });
  assert.deepEqual(data.originsOf([first, other]), [10, 50]);
  assert.deepEqual(data.extentOf([first, other]), [0, 9]);
});

test("a new segment, as after a rewind, is marked where its first track begins", () => {
  const { segments } = onlyPanel(
    [
      chart([
        track([0, 1]),
        track([5, 6], { segment: 1, track_id: 2 }),
        track([4, 6], { segment: 1, track_id: 1 }),
        truth([0, 6], { segment: null }),
      ]),
    ],
    false,
  );
  assert.deepEqual(
    segments.map(({ time }) => time),
    [4],
  );
});
