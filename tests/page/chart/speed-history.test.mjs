import assert from "node:assert/strict";
import { test } from "node:test";

import { SpeedHistory } from "../../../static/app/chart/speed-history.js";
import { body, line, obstacle } from "../made.mjs";

/** @import { ObstacleEntry, TrueBodyEntry } from "../../../static/app/contract" */

/**
 * @param {SpeedHistory} history
 * @param {number} sequence
 * @param {number} time
 * @param {Partial<ObstacleEntry>[]} obstacles
 * @param {Partial<TrueBodyEntry>[]} [truth]
 */
function tell(history, sequence, time, obstacles, truth = [], segment = 0) {
  history.add({
    type: "observation",
    sequence,
    age_ms: 0,
    line: line({
      time,
      segment,
      obstacles: obstacles.map((each) => obstacle({ velocity_time: time, ...each })),
    }),
    truth: truth.map(body),
  });
}

/** @param {SpeedHistory} history @param {string} key */
function curveOf(history, key) {
  const found = history.curves.get(key);
  assert.ok(found, `${key} is not among ${[...history.curves.keys()].join(", ")}`);
  return found;
}

test("a speed stands at the instant to which it belongs", () => {
  const history = new SpeedHistory(60);
  tell(history, 0, 2, [{ id: 3, speed: 0.4, velocity_time: 1.9 }]);
  const { times, speeds, stds, colour } = curveOf(history, "0/0/3");
  assert.deepEqual([times, speeds, stds, colour], [[1.9], [0.4], [0.02], "--track-3"]);
  assert.deepEqual(history.starts, [{ time: 1.9, speed: 0.4, words: "3", colour: "--track-3" }]);
});

test("what coasts or is not told is a gap, not a guess", () => {
  const history = new SpeedHistory(60);
  tell(history, 0, 0, [{}, { id: 2 }]);
  tell(history, 1, 0.1, [{ state: "coasting" }]);
  tell(history, 2, 0.2, [{}, { id: 2 }]);
  for (const key of ["0/0/1", "0/0/2"])
    assert.deepEqual(curveOf(history, key).speeds, [0.5, null, 0.5]);
});

test("where nothing came for more than a second the curve breaks", () => {
  const history = new SpeedHistory(60);
  tell(history, 0, 0, [{}]);
  tell(history, 1, 0.9, [{}]);
  tell(history, 2, 2.9, [{}]);
  assert.deepEqual(curveOf(history, "0/0/1").speeds, [0.5, 0.5, null, 0.5]);
});

test("a source that begins again goes on behind what was, with other tracks", () => {
  const history = new SpeedHistory(60);
  tell(history, 0, 5, [{}]);
  tell(history, 1, 6, [{}]);
  tell(history, 2, 0, [{}]);
  assert.equal(history.newest, 6.5);
  assert.deepEqual(history.playing, { begin: 6.5, end: 6.5, offset: 6.5 });
  assert.deepEqual(curveOf(history, "1/0/1").times, [6.5]);
  assert.equal(curveOf(history, "0/0/1").speeds.at(-1), null);
});

test("truth and what was commanded are curves, the observer's own are not", () => {
  const history = new SpeedHistory(60);
  tell(history, 0, 0, [], [{ commanded_speed: -0.3 }, { id: 8, role: "observer" }]);
  assert.deepEqual([...history.curves.keys()], ["truth/7", "commanded/7"]);
  assert.deepEqual(curveOf(history, "commanded/7").speeds, [0.3]);
});

test("another track in a body's place is noted, its loss and return are not", () => {
  const history = new SpeedHistory(60);
  [1, null, 1, 4].forEach((track_id, at) => tell(history, at, at / 10, [], [{ track_id }]));
  assert.deepEqual(history.changes, [{ time: 0.3, words: "1 → 4", colour: "--muted" }]);
});

test("what is older than the span is forgotten", () => {
  const history = new SpeedHistory(10);
  tell(history, 0, 0, [{ id: 1 }], [{ track_id: 1 }]);
  tell(history, 1, 0.1, [{ id: 1 }], [{ track_id: 2 }]);
  tell(history, 2, 10.05, [{ id: 2 }]);
  assert.ok(history.curves.has("0/0/1"));
  tell(history, 3, 10.2, [{ id: 2 }]);
  assert.deepEqual([...history.curves.keys()], ["0/0/2"]);
  assert.deepEqual([history.changes.length, history.starts.map(({ words }) => words)], [0, ["2"]]);
});

test("wheels are drawn by size, and only those of the source that plays", () => {
  const history = new SpeedHistory(60);
  const wheels = { role: /** @type {const} */ ("obstacle"), sent_mps: -0.2, encoder_mps: null };
  history.addWheels([{ ...wheels, time: 5 }]);
  assert.equal(history.curves.size, 0);
  tell(history, 0, 5, []);
  history.addWheels([
    { ...wheels, time: 5.1 },
    { ...wheels, time: 9 },
  ]);
  assert.deepEqual([...history.curves.keys()], ["sent/obstacle"]);
  assert.deepEqual(curveOf(history, "sent/obstacle").speeds, [0.2]);
});

test("late observations of the previous source are forgotten once the next one begins", () => {
  const history = new SpeedHistory(60, 2);
  tell(history, 7, 40, [{ id: 9 }], [{ id: 5, name: "cart" }]);
  tell(history, 8, 0.1, [{ id: 1 }]);
  assert.deepEqual(
    [...history.curves.values()].map(({ label }) => label),
    ["Obstacle 1"],
  );
  assert.deepEqual(
    history.starts.map(({ words }) => words),
    ["1"],
  );
  assert.equal(history.newest, 0.1);
  // Later, starting over is the source's own.
  tell(history, 9, 0, [{ id: 2 }]);
  assert.deepEqual(
    [...history.curves.values()].map(({ label }) => label),
    ["Obstacle 1", "Obstacle 2"],
  );
});

test("the window grows with what is stored, up to the span", () => {
  const history = new SpeedHistory(60);
  tell(history, 0, 100, [{}]);
  assert.equal(history.window_s, 10);
  tell(history, 1, 112, [{}]);
  assert.equal(history.window_s, 20);
  tell(history, 2, 131, [{}]);
  assert.equal(history.window_s, 60);
  assert.equal(new SpeedHistory(15).window_s, 10);
});

test("where no observation arrived, ground truth is not said to be missing", () => {
  const history = new SpeedHistory(60);
  tell(history, 0, 0, [], [{}]);
  tell(history, 1, 0.5, [], []);
  tell(history, 2, 1, [], [{}]);
  tell(history, 3, 4, [], [{}]);
  tell(history, 4, 0, [], [{}]);
  assert.equal(history.isSilent(0, 1), false);
  assert.equal(history.isSilent(1, 4), true);
  assert.equal(history.isSilent(4, 4.5), true);
  assert.equal(history.isSilent(3.9, 4.6), false);
});
