import assert from "node:assert/strict";
import { test } from "node:test";

import { FloorPick } from "../../../static/app/shell/floor-pick.js";

function pick() {
  const made = new FloorPick();
  /** @type {string[]} */
  const told = [];
  for (const type of ["change", "picked"]) made.addEventListener(type, () => told.push(type));
  return { made, told };
}

test("one click is taken, once it is asked for", () => {
  const { made, told } = pick();
  made.possible = true;
  made.answer({ ahead: 1, left: 0 });
  assert.equal(made.place, null);
  made.ask("Click");
  assert.deepEqual([made.asked, made.words], [true, "Click"]);
  made.answer({ ahead: 2, left: 1 });
  made.answer({ ahead: 3, left: 1 });
  assert.deepEqual(made.place, { ahead: 2, left: 1 });
  assert.deepEqual([made.asked, made.words], [false, ""]);
  assert.equal(told.filter((type) => type === "picked").length, 1);
});

test("a click that was cancelled is not taken", () => {
  const { made, told } = pick();
  made.possible = true;
  made.ask("Click");
  made.cancel();
  made.answer({ ahead: 2, left: 1 });
  assert.deepEqual([made.asked, made.words, made.place], [false, "", null]);
  assert.ok(!told.includes("picked"));
});

test("without a scene nothing is asked for", () => {
  const { made } = pick();
  made.ask("Click");
  assert.equal(made.asked, false);
  made.possible = true;
  made.ask("Click");
  made.possible = false;
  assert.equal(made.asked, false);
});

test("what became of it is told until it is taken away", () => {
  const { made } = pick();
  made.say("Not sent: why.", true);
  assert.deepEqual([made.words, made.refused], ["Not sent: why.", true]);
  // Nothing is requested, so there is nothing to cancel.
  made.cancel();
  assert.equal(made.words, "Not sent: why.");
  made.say("");
  assert.deepEqual([made.words, made.refused], ["", false]);
});
