import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import "../fake-page.mjs";

const { LiveView } = await import("../../../static/app/live/live-view.js");
mock.method(LiveView.prototype, "attach", () => {});
const { CaptureStep } = await import("../../../static/app/calibration/capture-step.js");

test("nobody is asked to show a board while the calibration is computed", () => {
  const look = { words: "Show the board", next: "Move it to the left", enough: true, coverage: {} };
  const calibrating = { source: "x", look, views: [], refused: [], automatic: true, trouble: null };
  const now = { ...calibrating, computing: { share: 0.5, words: "fitting" } };
  const hub = Object.assign(new Emitter(), { status: { calibrating: now } });
  const step = new CaptureStep();
  step.attach(/** @type {any} */ (hub));
  step.show(true);
  const words = String(step.textContent);
  assert.ok(words.startsWith("Computing the calibration"), words);
  assert.ok(!words.includes("Move it"), words);
});
