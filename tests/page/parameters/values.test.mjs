import assert from "node:assert/strict";
import { test } from "node:test";

import {
  differences,
  groupTitle,
  rangeInWords,
  valueInWords,
  withTitles,
} from "../../../static/app/parameters/value-words.js";
import { parameter } from "../made.mjs";

test("values and ranges are said with their unit", () => {
  assert.equal(valueInWords(15, parameter({})), "15 px");
  assert.equal(valueInWords(0.1 + 0.2, parameter({ unit: "" })), "0.3");
  assert.equal(valueInWords(1e-9, parameter({ unit: "" })), "1e-9");
  const told = (/** @type {string} */ unit) => valueInWords(1, parameter({ unit }));
  assert.deepEqual(
    ["frames", "matches", "grey levels/px", "m/s", "standard deviations"].map(told),
    ["1 frame", "1 match", "1 grey level/px", "1 m/s", "1 standard deviation"],
  );
  assert.equal(valueInWords(2, parameter({ unit: "frames" })), "2 frames");
  assert.equal(valueInWords(false, parameter({ type: "boolean", unit: "" })), "off");
  const detector = parameter({ type: "choice", unit: "", labels: { shi_tomasi: "Shi-Tomasi" } });
  assert.equal(valueInWords("shi_tomasi", detector), "Shi-Tomasi");
  assert.equal(valueInWords("added later", detector), "added later");
  assert.equal(valueInWords(0.3, parameter({ unit: "m/s^2" })), "0.3 m/s²");
  assert.equal(valueInWords(1, parameter({ unit: "m/s^2/sqrt(Hz)" })), "1 m/s²/√Hz");
  assert.equal(rangeInWords(parameter({})), "5 to 51 px");
  assert.equal(rangeInWords(parameter({ type: "choice" })), "");
  assert.equal(groupTitle("ego_motion"), "Ego-motion");
  assert.equal(groupTitle("klt_tracking"), "KLT tracking");
});

test("only what differs is compared, in the order of declaration", () => {
  const schema = [
    parameter({ name: "b.x" }),
    parameter({ name: "a.x" }),
    parameter({ name: "c.x" }),
  ];
  const found = differences(schema, [
    { "a.x": 1, "b.x": 2, "c.x": 3 },
    { "a.x": 4, "b.x": 5, "c.x": 3 },
    { "a.x": 1, "c.x": 3 },
  ]);
  assert.deepEqual(
    found.map(({ entry: { name }, words }) => [name, ...words]),
    [
      ["b.x", "2 px", "5 px", "–"],
      ["a.x", "1 px", "4 px", "1 px"],
    ],
  );
});

test("names of parameters are shown as the titles of their fields", () => {
  const schema = [parameter({})];
  assert.equal(
    withTitles("With flow.window_px at 9 or below (now 15), e.g. 0.5 s.", schema),
    "With Flow window size at 9 or below (now 15), e.g. 0.5 s.",
  );
  assert.equal(withTitles("A lower flow.other would.", schema), "A lower flow.other would.");
});
