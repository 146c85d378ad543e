import assert from "node:assert/strict";
import { test } from "node:test";

import * as words from "../../../static/app/driving/goal-words.js";
import { robot, robots } from "../made.mjs";

/** @import { RobotNow } from "../../../static/app/contract" */
/** @import { Hub } from "../../../static/app/shell/hub.js" */

/** @typedef {{observer?: RobotNow | null, ours?: boolean, programme?: string}} Known */
/** @typedef {Partial<Pick<Hub, "connection" | "robots" | "robotsOutdated">>} Heard */

/** A state in which nothing is missing, with a test's changes. @param {Known & Heard} changes */
function missing(changes) {
  const {
    observer = robot({ state: "armed", operator: "Ann" }),
    ours = true,
    programme = "",
    ...heard
  } = changes;
  const hub = {
    connection: /** @type {const} */ ("open"),
    robots: robots({ robots: { observer, obstacle: null } }),
    robotsOutdated: false,
    ...heard,
  };
  return words.missingForGoal(hub, ours, programme);
}

test("with an armed observer in one's own hands nothing is missing", () => {
  assert.equal(missing({}), "");
  assert.equal(missing({ observer: robot({ state: "moving", operator: "Ann" }) }), "");
});

test("what must be done first is told, the most urgent alone", () => {
  assert.match(missing({ connection: "closed" }), /^No connection/);
  assert.match(missing({ robots: null }), /^Waiting for robot status/);
  const stopped = robots({ stopped: { by: "Ann", since: 0 } });
  assert.match(missing({ robots: stopped }), /reset the stop first/);
  assert.match(missing({ observer: null }), /^Connect the observer first/);
  assert.match(missing({ ours: false }), /^Take control of the observer first/);
  const free = robot({ state: "armed" });
  assert.match(missing({ observer: free, ours: false }), /^Arm the observer first/);
  assert.match(missing({ observer: robot() }), /^Arm the observer first/);
  assert.match(missing({ programme: "Figure 17" }), /^The programme Figure 17 is running/);
});

test("no goal is sent while nothing is heard of the robots", () => {
  assert.equal(missing({ robotsOutdated: true }), "The server is not responding.");
  const process = { alive: false, pid: null, restarts: 1, trouble: null };
  const dead = robots({ process });
  assert.equal(
    missing({ robotsOutdated: true, robots: dead }),
    "The drive process is restarting; until then, only the robots' own firmware can stop them.",
  );
});

test("a place that was typed is read, or refused in a sentence", () => {
  assert.deepEqual(words.parseGoal("2.5", "-0.5"), { ahead: 2.5, left: -0.5 });
  assert.deepEqual(words.parseGoal("0", "0"), { ahead: 0, left: 0 });
  for (const [ahead, left] of [
    ["", "0"],
    ["1", " "],
    ["a", "0"],
    ["Infinity", "0"],
  ])
    assert.match(String(words.parseGoal(ahead ?? "", left ?? "")), /^Enter both distances/);
  assert.match(String(words.parseGoal("15", "15")), /^The place is 21\.2 m away/);
  assert.equal(words.tooFarReason({ ahead: 20, left: 0 }), "");
});

test("a place is told by its sides", () => {
  assert.equal(words.placeInWords({ ahead: 2, left: -0.5 }), "2.00 m ahead, 0.50 m to the right");
  assert.equal(words.placeInWords({ ahead: -1, left: 0.251 }), "1.00 m behind, 0.25 m to the left");
  assert.equal(words.placeInWords({ ahead: 0.001, left: 0 }), "where the robot stands");
});

test("a refusal begins with what did not happen", () => {
  assert.equal(
    words.refusalSentence("Not sent", "Arm the observer first."),
    "Not sent: arm the observer first.",
  );
});

test("another number alone is no news", () => {
  const [one, two] = ["it will cross in 1.4 s", "it will cross in 12 s"].map(words.stripNumbers);
  assert.equal(one, two);
});

test("the first risk is the server's, and none is offered twice", () => {
  const offered = (/** @type {number | undefined} */ usual) =>
    words.riskChoices(usual).map(([value, told]) => [value, told?.split(" ")[0]]);
  const others = [
    ["0.0001", "0.0001"],
    ["0.001", "0.001"],
    ["0.01", "0.01"],
  ];
  assert.deepEqual(offered(undefined), [["", "Default"], ...others]);
  assert.deepEqual(offered(0.001), [
    ["", "0.001"],
    ...others.filter(([value]) => value !== "0.001"),
  ]);
  assert.deepEqual(offered(0.0005), [["", "0.0005"], ...others]);
});
