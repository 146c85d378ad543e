import assert from "node:assert/strict";
import { test } from "node:test";

import {
  unusedName,
  parsePreset,
  presetFile,
  refusalOf,
} from "../../../static/app/parameters/preset-files.js";
import { ApiError } from "../../../static/app/shell/api.js";

const VALUES = { "flow.window_px": 21, "features.detector": "fast", "matching.cross_check": false };

test("what was saved is read again", () => {
  const { text, fileName } = presetFile({ name: "Köln, lab 3", help: "of May", values: VALUES });
  assert.equal(fileName, "Köln-lab-3.preset.json");
  assert.deepEqual(parsePreset(text, fileName), {
    name: "Köln, lab 3",
    help: "of May",
    values: VALUES,
  });
});

test("what is no preset is refused in one sentence that names the file", () => {
  const format = '"format": "dynamic-observer preset"';
  /** @type {[string, RegExp][]} */
  const files = [
    ["", /^a\.json is not a preset: it is not JSON\.$/],
    ["{", /it is not JSON/],
    ["null", /its "format" must be/],
    ["[]", /its "format" must be/],
    ['{"flow.window_px": 21}', /its "format" must be "dynamic-observer preset"/],
    [`{${format}}`, /has no "values"/],
    [`{${format}, "values": [1]}`, /has no "values"/],
  ];
  for (const [text, why] of files) assert.match(refused(text), why, text);
});

/** @param {string} text */
function refused(text) {
  try {
    parsePreset(text, "a.json");
    return "it was taken";
  } catch (error) {
    return refusalOf("a.json", error);
  }
}

test("a name that is missing is taken from the file, and a long or odd one is made plain", () => {
  const named = (/** @type {unknown} */ name, file = "lab.preset.json") =>
    parsePreset(JSON.stringify({ format: "dynamic-observer preset", name, values: {} }), file).name;
  assert.equal(named(undefined), "lab");
  assert.equal(named(" two\nlines "), "two lines");
  assert.equal(named("x".repeat(200)).length, 100);
  assert.equal(named("", ".json"), "imported");
});

test("a name that is taken gets a number", () => {
  assert.equal(unusedName("mine", ["paper"]), "mine");
  assert.equal(unusedName("mine", ["mine", "mine 2"]), "mine 3");
  assert.equal(unusedName("x".repeat(100), ["x".repeat(100)]).length, 100);
});

test("why the server refuses is one sentence with the parameter's name", () => {
  const one = new ApiError("Must be below 10.", 422, { "a.x": "must be below 10" });
  assert.equal(refusalOf("a.json", one), "a.json was not imported: a.x: must be below 10.");
  const two = new ApiError("", 422, { "a.x": "must be below 10", "a.y": "is too much" });
  assert.equal(
    refusalOf("a.json", two),
    "a.json was not imported: a.x: must be below 10, and 1 more.",
  );
  const none = new ApiError("The server is not responding.", 0);
  assert.equal(refusalOf("a.json", none), "a.json was not imported: The server is not responding.");
});
