import assert from "node:assert/strict";
import { test } from "node:test";

import { areRobotsOutdated, assessFreshness } from "../../../static/app/shell/hub.js";
import { robots } from "../made.mjs";

/** @import { RobotsMessage, Status } from "../../../static/app/contract" */

const NOW = 100_000;

/** The status of a source that is playing. @param {Record<string, unknown>} [changes] */
function status(changes) {
  const whole = {
    engine: { state: "preview", reason: null },
    source: { spec: "simulated:lab" },
    playback: { paused: false, ended: false, frame: 3 },
    live: null,
    ...changes,
  };
  // The rest of it does not affect freshness.
  return /** @type {Status} */ (/** @type {unknown} */ (whole));
}

/** @param {number} silent_s @param {number | null} age_s */
const heartbeat = (silent_s, age_s) => ({ at: NOW - 1000 * silent_s, age_s });

test("before the server spoke nothing is stale, after it was lost everything is", () => {
  assert.equal(assessFreshness("connecting", null, null, NOW).state, "none");
  assert.equal(assessFreshness("open", null, null, NOW).state, "none");
  const lost = assessFreshness("closed", status(), heartbeat(4, 0.5), NOW);
  assert.deepEqual([lost.state, lost.age_s], ["stale", 4.5]);
  assert.match(lost.reason, /Reconnecting\.$/);
  assert.match(
    assessFreshness("closed", status(), heartbeat(20, 0.5), NOW).reason,
    /open the link/,
  );
});

test("fresh is what is a second old at most, the silence since then included", () => {
  assert.equal(assessFreshness("open", status(), heartbeat(0.5, 0.5), NOW).state, "fresh");
  const old = assessFreshness("open", status(), heartbeat(0.6, 0.5), NOW);
  assert.deepEqual([old.state, old.reason], ["stale", "No new frames are arriving."]);
});

test("a server that is silent for more than a second makes all of it stale", () => {
  const silent = assessFreshness("open", status(), heartbeat(1.1, 0), NOW);
  assert.equal(silent.state, "stale");
  assert.match(silent.reason, /^The server is not responding/);
});

test("an engine that failed says why", () => {
  const engine = { state: "failed", reason: "the camera is busy" };
  const failed = assessFreshness("open", status({ engine }), heartbeat(0, 0), NOW);
  assert.deepEqual([failed.state, failed.reason], ["stale", "The camera is busy."]);
});

test("what was paused or has ended is held, and does not count as stale", () => {
  const paused = { paused: true, ended: false, frame: 12 };
  const held = assessFreshness("open", status({ playback: paused }), heartbeat(0.1, 60), NOW);
  assert.deepEqual([held.state, held.reason], ["held", "Paused at frame 12."]);
  const ended = { paused: true, ended: true, frame: 12 };
  assert.equal(
    assessFreshness("open", status({ playback: ended }), heartbeat(0.1, 60), NOW).reason,
    "The source has ended.",
  );
});

test("a camera's trouble counts before the age of what it sent last", () => {
  const live = { trouble: "the left camera sends nothing" };
  const troubled = assessFreshness("open", status({ live }), heartbeat(0, 0), NOW);
  assert.deepEqual([troubled.state, troubled.reason], ["stale", "The left camera sends nothing."]);
});

test("without a source, while calibrating and before the first frame there is nothing", () => {
  for (const [changes, reason] of /** @type {const} */ ([
    [{ source: null }, "No source is open."],
    [{ engine: { state: "calibrating", reason: null } }, "Calibration in progress."],
    [{}, "Waiting for the first frame."],
  ])) {
    const checkedAt = assessFreshness("open", status(changes), heartbeat(0, null), NOW);
    assert.deepEqual([checkedAt.state, checkedAt.reason], ["none", reason]);
  }
});

test("what is known of robots is outdated once the server is silent, or drive is gone", () => {
  assert.equal(areRobotsOutdated("open", null, NOW - 900, NOW), false);
  assert.equal(areRobotsOutdated("open", null, NOW - 1100, NOW), true);
  assert.equal(areRobotsOutdated("closed", null, NOW, NOW), true);
  const process = /** @type {RobotsMessage["process"]} */ ({ alive: false });
  assert.equal(areRobotsOutdated("open", robots({ process }), NOW, NOW), true);
});
