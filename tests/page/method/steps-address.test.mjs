import assert from "node:assert/strict";
import { test } from "node:test";

import * as address from "../../../static/app/method/steps-address.js";
import { placeOf } from "../../../static/app/runs/run-words.js";

const PLACE = {
  step: 4,
  source: "simulated:lab?seed=3",
  frame: 40,
  preset: "paper",
  changes: { "flow.residual_threshold_px": "2.5" },
};

test("the address carries all that a step is made of", () => {
  const hash = address.addressOf(PLACE);
  assert.equal(
    hash,
    "#steps/4?source=simulated:lab%3Fseed%3D3&frame=40&preset=paper&p.flow.residual_threshold_px=2.5",
  );
  assert.deepEqual(address.placeOfAddress(hash), PLACE);
  assert.equal(placeOf(hash).view, "steps");
});

test("an address that somebody typed leads to the first step at worst", () => {
  const first = { step: 1, source: null, frame: null, preset: "paper", changes: {} };
  for (const hash of ["#steps", "#steps/", "#steps/12", "#steps/x?frame=-3", "#steps?frame=soon"]) {
    assert.deepEqual(address.placeOfAddress(hash), first, hash);
    assert.equal(placeOf(hash).view, "steps", hash);
  }
  const typed = address.placeOfAddress("#steps/2?source=simulated:lab?seed=3&frame=7");
  assert.deepEqual([typed.source, typed.frame], ["simulated:lab?seed=3", 7]);
  assert.equal(placeOf("#stepson").view, "none");
});

test("the server is asked for the pair, whatever the step", () => {
  assert.equal(
    address.queryOf({ ...PLACE, changes: {} }, { dark: "true" }).toString(),
    "source=simulated%3Alab%3Fseed%3D3&frame=40&preset=paper&dark=true",
  );
});

test("keys lead from step to step and not beyond", () => {
  assert.equal(address.stepByKey("ArrowRight", 4, false), 5);
  assert.equal(address.stepByKey("ArrowLeft", 1, false), null);
  assert.equal(address.stepByKey("ArrowRight", 9, false), null);
  assert.equal(address.stepByKey("PageDown", 2, false), null);
  assert.equal(address.stepByKey("PageDown", 2, true), 3);
  assert.equal(address.stepByKey("7", 2, false), 7);
  assert.equal(address.stepByKey("0", 2, false), null);
  assert.equal(address.stepByKey("a", 2, false), null);
});

test("places differ by everything but the step", () => {
  assert.ok(address.areSameFrames(PLACE, { ...PLACE, step: 9 }));
  for (const change of [{ source: null }, { frame: 41 }, { preset: "default" }, { changes: {} }])
    assert.ok(!address.areSameFrames(PLACE, { ...PLACE, ...change }));
  assert.ok(!address.areSameFrames(PLACE, null));
});

test("a place asks for its preset's values with its own changes", () => {
  const preset = { "a.size": 15, "a.on": true, "a.model": "affine", "a.other": 1 };
  const valuesAt = (/** @type {Record<string, string>} */ changes) =>
    address.valuesAt({ ...PLACE, changes }, preset);
  assert.deepEqual(valuesAt({ "a.size": "2.5", "a.on": "false", "a.model": "homography" }), {
    ...preset,
    "a.size": 2.5,
    "a.on": false,
    "a.model": "homography",
  });
  for (const size of ["", " ", "soon"]) assert.deepEqual(valuesAt({ "a.size": size }), preset);
  assert.deepEqual(valuesAt({}), preset);
});
