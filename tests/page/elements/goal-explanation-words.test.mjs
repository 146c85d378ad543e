import assert from "node:assert/strict";
import { test } from "node:test";

import {
  figuresOfGoal,
  refusalsInWords,
} from "../../../static/app/elements/goal-explanation-words.js";
import { goal } from "../made.mjs";

/** @import { GoalNow, RefusedPath } from "../../../static/app/contract" */

/** @param {Partial<RefusedPath>} changes @returns {RefusedPath} */
function path(changes) {
  return {
    direction: 0,
    speed_mps: 0.5,
    path: [],
    cause: "risk",
    risk: 0.0412,
    track: 3,
    meets_s: 1.2,
    guard: null,
    ...changes,
  };
}

test("who decides and the risks are told as far as they are known", () => {
  const figures = (/** @type {Partial<GoalNow>} */ changes) =>
    figuresOfGoal(goal(changes)).map(([, text]) => text);
  assert.deepEqual(figures({}), ["no obstacle", "0.001 accepted, 0.0002 planned"]);
  assert.deepEqual(
    figures({ waits_for: 3, risk_per_metre: 0.0015, planned_risk_per_metre: null }),
    ["obstacle 3", "0.0015 accepted"],
  );
  assert.equal(
    figures({ waits_for: -2, meets_s: 1.42 })[0],
    "an object that has started to move: driving straight on, the robot would meet it in 1.4 s",
  );
  assert.equal(
    figures({ planned_risk_per_metre: 1e-9 })[1],
    "0.001 accepted, below 0.00001 planned",
  );
});

test("each refused path is one sentence, from left to right", () => {
  const refused = [
    path({ direction: -0.4, cause: "later", risk: 0.131, meets_s: 2.6 }),
    path({}),
    path({ direction: 0.78, speed_mps: 0.31, track: -1, risk: 1 }),
    path({
      direction: -0.8,
      cause: "guard",
      risk: null,
      track: null,
      meets_s: null,
      guard: "obstacle 2 is within the stopping distance",
    }),
    path({ direction: 1.2, cause: "surface", risk: null, track: null, meets_s: 3.4 }),
  ];
  assert.deepEqual(refusalsInWords(goal({ refused })), [
    "Left by 70° at 0.5 m/s: would reach an obstruction in 3.4 s.",
    "Left by 45° at 0.3 m/s: would meet an object that has started to move in 1.2 s (risk per metre 1).",
    "Straight on at 0.5 m/s: would meet obstacle 3 in 1.2 s (risk per metre 0.04).",
    "Right by 25° at 0.5 m/s: would meet obstacle 3 in 2.6 s (probability 13 %).",
    "Right by 45° at 0.5 m/s: rejected by the guard, obstacle 2 is within the stopping distance.",
  ]);
  assert.equal(refused[0]?.direction, -0.4);
});

test("nothing refused, nothing said", () => {
  assert.deepEqual(refusalsInWords(goal()), []);
});
