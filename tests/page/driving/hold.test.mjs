import assert from "node:assert/strict";
import { test } from "node:test";

import { applyDeadZone, Hold } from "../../../static/app/driving/hold.js";

const AHEAD = { forward: 1, left: 0 };
const LEFT = { forward: 0, left: 1 };

/** A hold and the events it has fired. */
function held() {
  const hold = new Hold();
  /** @type {string[]} */
  const told = [];
  for (const type of ["pressed", "released", "cleared"])
    hold.addEventListener(type, () => told.push(type));
  return { hold, told };
}

test("near its middle nothing moves, and beyond it grows from zero to one", () => {
  assert.deepEqual([0, 0.11, -0.11].map(applyDeadZone), [0, 0, 0]);
  assert.deepEqual([1, -1, 3].map(applyDeadZone), [1, -1, 1]);
  assert.ok(Math.abs(applyDeadZone(0.13)) < 0.02);
  assert.ok(applyDeadZone(-0.5) < 0);
});

test("what was pressed last steers, until the last is let go", () => {
  const { hold, told } = held();
  hold.set("keys", AHEAD);
  hold.set("pad", LEFT);
  assert.deepEqual(hold.deflection, LEFT);
  hold.release("pad");
  assert.deepEqual(hold.deflection, AHEAD);
  assert.deepEqual(told, ["pressed"]);
  hold.release("keys");
  assert.equal(hold.deflection, null);
  assert.deepEqual(told, ["pressed", "released"]);
});

test("what is blocked counts for nothing until all of it was let go", () => {
  const { hold, told } = held();
  hold.set("keys", AHEAD);
  hold.block("The link was lost.");
  assert.deepEqual([hold.isHeld, hold.isActive, hold.deflection], [true, false, null]);
  hold.set("pad", LEFT);
  assert.equal(hold.deflection, null);
  hold.release("keys");
  assert.equal(hold.blockedReason, "The link was lost.");
  hold.release("pad");
  assert.equal(hold.blockedReason, "");
  hold.set("keys", AHEAD);
  assert.deepEqual(hold.deflection, AHEAD);
  assert.deepEqual(told, ["pressed", "released", "pressed"]);
});

test("nothing is blocked while nothing counts", () => {
  const { hold, told } = held();
  hold.block("Nobody holds anything.");
  assert.deepEqual([hold.blockedReason, told], ["", []]);
});

test("what is cleared must be pressed again", () => {
  const { hold, told } = held();
  hold.set("gamepad", AHEAD);
  hold.releaseAll();
  assert.deepEqual([hold.isHeld, hold.deflection], [false, null]);
  assert.deepEqual(told, ["pressed", "cleared", "released"]);
});

test("letting go of what was not held tells nothing", () => {
  const { hold, told } = held();
  hold.release("pad");
  assert.deepEqual(told, []);
});
