import assert from "node:assert/strict";
import { test } from "node:test";

import "../fake-page.mjs";
import { run } from "../made.mjs";

const { RunChart } = await import("../../../static/app/runs/run-chart.js");

test("the range being typed is not overwritten while a running run is read again", () => {
  const chart = new RunChart();
  chart.connectedCallback();
  const [from, to] = [...chart.querySelectorAll("input")].filter(
    (input) => input.getAttribute("type") === "number",
  );
  if (!from || !to) throw new Error("no range");
  from.value = "0.3";
  to.value = "0.7";
  Object.assign(document, { activeElement: from });
  chart.show([]);
  assert.deepEqual([from.value, to.value], ["0.3", "1.00"]);
  from.dispatchEvent(new Event("blur"));
  assert.equal(from.value, "0.00");
});

test("a run without speeds has nothing to zoom and no errors", () => {
  const chart = new RunChart();
  chart.connectedCallback();
  const none = { alignment: null, choices: null, curves: [], changes: [], errors: [] };
  chart.show([{ run: run(), aligned: false, sentence: null, ...none }]);
  const [tools, panels, , , errors] = /** @type {HTMLElement[]} */ ([...chart.children]);
  assert.equal(panels?.textContent, "No speeds in this run.");
  assert.deepEqual([tools?.hidden, errors?.hidden], [true, true]);
});
