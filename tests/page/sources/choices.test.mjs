import assert from "node:assert/strict";
import { test } from "node:test";

import * as choices from "../../../static/app/sources/choices.js";
import { run } from "../made.mjs";

/** @import { SourceEntry, VideoDevice } from "../../../static/app/contract" */
/** @import { Choice } from "../../../static/app/sources/choices.js" */

/** @param {Partial<SourceEntry>} [changes] @returns {SourceEntry} */
function entry(changes) {
  return {
    spec: "simulated:lab",
    title: "The lab",
    help: "A P3-DX crosses the lab.",
    group: "simulated",
    template: false,
    picture: true,
    board: null,
    recent: null,
    ...changes,
  };
}

const LAB = entry();
const PEOPLE = entry({ spec: "simulated:people", title: "People in the lab", help: "One waves." });
const BOARD = entry({
  spec: "simulated:calibration",
  title: "Two webcams and a chessboard",
  help: "To calibrate.",
  board: { kind: "chessboard", columns: 9, rows: 6, square_mm: 25, words: "" },
});
const ALL = [LAB, PEOPLE, BOARD].map(choices.choiceOfEntry);

/** @param {Choice[]} some */
function specs(some) {
  return some.map(({ spec }) => spec);
}

test("what was opened lately is suggested first, then what is called so, then what is told so", () => {
  const folder = choices.choiceOfEntry(
    entry({ spec: "/data/lab", title: "lab", group: "folders", recent: 0 }),
  );
  const text = choices.choiceOfEntry(entry({ spec: "x", title: "y", help: "In the lab." }));
  assert.deepEqual(specs(choices.suggestions([text, ...ALL, folder], "LAB", 9)), [
    "/data/lab",
    "simulated:lab",
    "simulated:people",
    "x",
  ]);
  assert.deepEqual(specs(choices.suggestions(ALL, "lab people", 9)), ["simulated:people"]);
  assert.deepEqual(choices.suggestions(ALL, "nonsense", 9), []);
  assert.equal(choices.suggestions(ALL, " ", 9).length, ALL.length);
});

test("no group hides another one", () => {
  const kept = choices.choicesOfRuns([run({ id: "1", name: "People on Monday" })]);
  const many = Array.from({ length: 20 }, (_, k) =>
    choices.choiceOfEntry(entry({ spec: `simulated:people_${k}` })),
  );
  const found = choices.suggestions([...many, ...kept], "people", 6);
  assert.equal(found.length, 7);
  assert.equal(found.at(-1)?.title, "People on Monday");
});

test("a source that is known twice is offered once, as recent as either", () => {
  const kept = choices.choicesOfRuns([run({ id: "r1", name: "Morning" })]);
  const listed = choices.choiceOfEntry(
    entry({ spec: "run:r1", title: "Old name", group: "recordings", recent: 2 }),
  );
  const [one, ...others] = choices.merged([...kept, listed]);
  assert.equal(others.length, 0);
  assert.equal(one?.title, "Morning");
  assert.equal(one?.recent, 2);
});

test("only runs that can be played are offered, by their names", () => {
  const some = [
    run({ id: "a b", name: "Kept" }),
    run({ record: "none" }),
    run({ state: "running" }),
    run({ frames: 0 }),
  ];
  const [kept, ...others] = choices.choicesOfRuns(some);
  assert.equal(others.length, 0);
  assert.equal(kept?.spec, "run:a b");
  assert.equal(kept?.picture, "/api/runs/a%20b/frames/0.jpg");
});

test("the path of a run's recording is told as the run", () => {
  assert.equal(choices.shortSpec("/data/runs/20261126-a1/recording.mcap"), "run:20261126-a1");
  for (const other of ["/data/runs/x/clip-1.mcap", "simulated:lab", "recording.mcap"])
    assert.equal(choices.shortSpec(other), other);
});

test("what has to be typed is marked in a template", () => {
  /** @param {string} spec */
  const marked = (spec) => spec.slice(...choices.placeholders(spec));
  assert.equal(marked("camera:LEFT,RIGHT"), "LEFT,RIGHT");
  assert.equal(marked("rtsp://LEFT,rtsp://RIGHT"), "LEFT,rtsp://RIGHT");
  assert.equal(marked("FOLDER"), "FOLDER");
  assert.equal(marked("RECORDING.mcap"), "RECORDING");
});

test("the board of a scenario is known with a seed, too", () => {
  const entries = [LAB, BOARD];
  assert.equal(choices.boardOf(entries, "simulated:calibration")?.square_mm, 25);
  assert.equal(choices.boardOf(entries, " simulated:calibration?seed=3 ")?.square_mm, 25);
  assert.equal(choices.boardOf(entries, "simulated:lab"), null);
  assert.equal(choices.boardOf(entries, ""), null);
});

test("the first two cameras are one choice, set as one bus can carry", () => {
  /** @param {number} at @returns {VideoDevice} */
  const camera = (at) => ({
    path: `/dev/video${at}`,
    by_path: at === 0 ? "/dev/v4l/by-path/left" : null,
    card: "HD Webcam",
    trouble: null,
    modes: [
      { pixel_format: "YUYV", width: 640, height: 480, rates: [30] },
      { pixel_format: "MJPG", width: 640, height: 480, rates: [30] },
    ],
    controls: [],
  });
  assert.deepEqual(choices.choicesOfCameras([camera(0)]), []);
  const [pair] = choices.choicesOfCameras([camera(0), camera(2), camera(4)]);
  assert.equal(
    pair?.spec,
    "camera:/dev/v4l/by-path/left,/dev/video2?size=640x480&format=MJPG&rate=30",
  );
  assert.equal(pair?.title, "HD Webcam");
  assert.equal(choices.cameraSpec("0", "", ""), "camera:sbs:0");
});

test("the open source is among the first few, whatever was opened lately", () => {
  assert.deepEqual(specs(choices.firstFew(ALL, 2, "simulated:lab")), [
    "simulated:lab",
    "simulated:people",
  ]);
  assert.deepEqual(specs(choices.firstFew(ALL, 2, "simulated:calibration")), [
    "simulated:lab",
    "simulated:calibration",
  ]);
  assert.deepEqual(specs(choices.firstFew(ALL, 2, "camera:0,1")), [
    "simulated:lab",
    "simulated:people",
  ]);
  assert.deepEqual(specs(choices.firstFew(ALL, 9, "simulated:calibration")), specs(ALL));
});
