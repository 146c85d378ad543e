import assert from "node:assert/strict";
import { test } from "node:test";

import * as words from "../../../static/app/runs/run-words.js";
import { counted } from "../../../static/app/elements/words.js";
import { run } from "../made.mjs";

test("sizes have two or three digits and the next unit in time", () => {
  assert.deepEqual([0, 999, 1000, 99_400, 99_600, 999_600, 1.4e9].map(words.size), [
    "0 B",
    "999 B",
    "1.0 kB",
    "99 kB",
    "100 kB",
    "1.0 MB",
    "1.4 GB",
  ]);
  assert.equal(words.size(null), "–");
});

test("one is not many", () => {
  assert.deepEqual(
    [0, 1, 2].map((count) => counted(count, "run")),
    ["0 runs", "1 run", "2 runs"],
  );
});

test("a run is told by source, duration and what it holds", () => {
  const told = words.facts(run({ segments: 2, recording_bytes: 2e6 })).split(" · ");
  assert.equal(told[0], "simulated:lab");
  assert.deepEqual(told.slice(2), ["1 min 10.5 s", "100 frames", "2 segments", "2.0 MB"]);
});

test("a run is as long as what was observed, and no length is told where none is known", () => {
  const told = words.facts(run({ state: "interrupted", ended_at: null, duration_s: null }));
  assert.match(told, /^simulated:lab · [^·]+ · 100 frames$/);
});

test("only a kept recording with images is played", () => {
  assert.equal(words.hasImages(run()), true);
  assert.equal(words.hasImages(run({ state: "running" })), false);
  assert.equal(words.hasImages(run({ record: "none" })), false);
  assert.equal(words.hasImages(run({ record: null })), false);
});

test("a run is empty once it has ended without a frame", () => {
  assert.equal(words.isEmpty(run({ state: "failed", frames: 0 })), true);
  assert.equal(words.isEmpty(run({ state: "failed", frames: 1 })), false);
  assert.equal(words.isEmpty(run({ state: "running", frames: 0 })), false);
  // Its recording may hold more than was counted.
  assert.equal(words.isEmpty(run({ state: "interrupted", frames: 0 })), false);
});

test("an address leads back to what it was made of", () => {
  assert.deepEqual(words.placeOf(words.runHref("a/b c")), { view: "run", ids: ["a/b c"] });
  assert.deepEqual(words.placeOf(words.compareHref(["a,b", "c"])), {
    view: "compare",
    ids: ["a,b", "c"],
  });
});

test("an address that somebody typed leads to the list at worst", () => {
  assert.deepEqual(words.placeOf("#runs"), { view: "list", ids: [] });
  assert.deepEqual(words.placeOf("#runs/compare/only"), { view: "list", ids: [] });
  assert.deepEqual(words.placeOf("#runs/%E0%A4"), { view: "run", ids: ["%E0%A4"] });
  assert.deepEqual(words.placeOf("#elsewhere"), { view: "none", ids: [] });
});

test("a calibration is told by its name, or as the source's own", () => {
  const library = [{ id: "6c01104f2ad8aa", name: "Bench" }];
  const told = (/** @type {string | null} */ id, source = "camera:0,1") =>
    words.calibrationInWords(id, source, library);
  assert.equal(told("6c01104f2ad8aa"), "Bench");
  assert.equal(told(null), "the source's own");
  assert.equal(told("ffffffffffffff", "simulated:people"), "the source's own");
  assert.match(told("ffffffffffffff"), /^the source's own, or one deleted since \(ffffffffffff\)$/);
});
