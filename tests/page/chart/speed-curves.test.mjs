import assert from "node:assert/strict";
import { test } from "node:test";

import {
  firstFrom,
  gapsIn,
  joined,
  legendEntries,
  speedAt,
  withBand,
} from "../../../static/app/chart/speed-curves.js";
import { SIGMAS_95 } from "../../../static/app/elements/facts.js";

/**
 * @param {number[]} times
 * @param {(number | null)[]} speeds
 * @param {Partial<import("../../../static/app/chart/speed-curves.js").Curve>} [changes]
 * @returns {import("../../../static/app/chart/speed-curves.js").Curve}
 */
function curve(times, speeds, changes) {
  const stds = speeds.map(() => null);
  return {
    key: "k",
    kind: "truth",
    label: "",
    colour: "",
    banded: false,
    times,
    speeds,
    stds,
    ...changes,
  };
}

test("curves over different times stand over all of them", () => {
  const [times, first, second] = joined([curve([0, 2], [1, 3]), curve([1, 2], [5, 6])]);
  assert.deepEqual(times, [0, 1, 2]);
  assert.deepEqual(first, [1, undefined, 3]);
  assert.deepEqual(second, [undefined, 5, 6]);
});

test("a gap stays broken at the times of other curves", () => {
  const [, broken] = joined([
    curve([0, 1, 4], [1, null, 2]),
    curve([0, 2, 3, 4, 5], [1, 1, 1, 1, 1]),
  ]);
  assert.deepEqual(broken, [1, null, null, null, 2, undefined]);
});

test("a band has its edges before the curve, and none below zero", () => {
  const rows = joined([curve([0, 1], [1, 0.1], { banded: true, stds: [0.1, 1] })]);
  assert.equal(rows.length, 4);
  assert.deepEqual(rows[1], [1 + SIGMAS_95 * 0.1, 0.1 + SIGMAS_95]);
  assert.deepEqual(rows[2], [1 - SIGMAS_95 * 0.1, 0]);
  assert.deepEqual(rows[3], [1, 0.1]);
});

test("a band is broken where no deviation is known", () => {
  const [, upper] = joined([curve([0, 1, 2], [1, 1, null], { banded: true, stds: [0, null, 1] })]);
  assert.deepEqual(upper, [1, null, null]);
});

test("between two samples the nearer one speaks", () => {
  const of = curve([0, 10], [1, 2], { stds: [0.1, null] });
  assert.deepEqual(speedAt(of, 4, 0.5), { speed: 1, std: 0.1 });
  assert.deepEqual(speedAt(of, 6, 0.5), { speed: 2, std: null });
});

test("no speed is read across a gap, or beyond a curve's reach", () => {
  const of = curve([0, 1, 5], [1, null, 2]);
  assert.equal(speedAt(of, 3, 0.5), null);
  assert.deepEqual(speedAt(of, 4.6, 0.5), { speed: 2, std: null });
  assert.equal(speedAt(of, 5.6, 0.5), null);
  assert.deepEqual(speedAt(of, -0.4, 0.5), { speed: 1, std: null });
  assert.equal(speedAt(curve([], []), 0, 1), null);
});

test("a gap lasts from the last sample before it to the first behind it", () => {
  assert.deepEqual(gapsIn(curve([0, 1, 2, 3, 4, 5], [null, 1, null, null, 2, null])), [
    { begin: 1, end: 4 },
  ]);
});

test("a speed is told with its middle 95 %", () => {
  assert.equal(withBand({ speed: 1, std: 0.1 }), "1.00 (0.80–1.20)");
  assert.equal(withBand({ speed: 0.1, std: 0.1 }), "0.10 (0.00–0.30)");
  assert.equal(withBand({ speed: 1, std: null }), "1.00");
  assert.equal(withBand(null), "–");
});

test("the first that is not below is found, at the ends too", () => {
  const rising = [1, 2, 2, 4];
  assert.deepEqual(
    [0, 2, 3, 4, 5].map((value) => firstFrom(rising, value)),
    [0, 1, 3, 3, 4],
  );
});

test("in a legend, curves of truth share an entry, and each track has its own", () => {
  const entries = legendEntries(
    [
      curve([], [], { kind: "estimate", label: "Obstacle 1", colour: "--track-1" }),
      curve([], [], { kind: "estimate", label: "Obstacle 9", colour: "--track-1" }),
      curve([], [], { label: "Ground truth Ada" }),
      curve([], [], { kind: "commanded", label: "Commanded Ada" }),
      curve([], [], { label: "Ground truth Ben" }),
    ],
    ({ kind }) => (kind === "truth" ? "1.10" : "1.00"),
  );
  assert.deepEqual(
    entries.map(({ words }) => words),
    ["Obstacle 1 1.00", "Obstacle 9 1.00", "Ground truth Ada 1.10, Ben 1.10", "Commanded Ada 1.00"],
  );
});
