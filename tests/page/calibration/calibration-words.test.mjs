import assert from "node:assert/strict";
import { test } from "node:test";

import { refusalInWords } from "../../../static/app/calibration/calibration-words.js";

test("a refused file is named once", () => {
  const one = (/** @type {string} */ why) => refusalInWords(["a.yaml"], why);
  assert.equal(one("a.yaml: no key T."), "a.yaml not imported: no key T.");
  assert.equal(one("a.yaml is not a text file."), "Not imported: a.yaml is not a text file.");
  assert.equal(one("The file is empty."), "a.yaml not imported: The file is empty.");
});

test("of two files the one at fault is named", () => {
  assert.equal(
    refusalInWords(["a.yaml", "b.yaml"], "b.yaml: no key T."),
    "a.yaml and b.yaml not imported: b.yaml: no key T.",
  );
});
