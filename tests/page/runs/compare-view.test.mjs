import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { serve, settled } from "../fake-page.mjs";
import { parameter, run } from "../made.mjs";

/** @import { Hub } from "../../../static/app/shell/hub.js" */

// As the library of the charts asks for; nothing is drawn here.
if (!("navigator" in globalThis)) Object.assign(globalThis, { navigator: { userAgent: "" } });
Object.assign(globalThis, { devicePixelRatio: 1 });
const { RunChart } = await import("../../../static/app/runs/run-chart.js");
mock.method(RunChart.prototype, "show", () => {});
const { CompareView } = await import("../../../static/app/runs/compare-view.js");

const PARAMETER = parameter({ name: "flow.window_px", title: "Flow window size" });

/** Answer for a run's chart, or for the declared parameters. @param {string} path */
function answer(path) {
  if (path === "/parameters/schema") return [PARAMETER];
  const id = path.split("/")[2] ?? "";
  const parameters = { [PARAMETER.name]: id === "a" ? 15 : 21 };
  return { run: run({ id, name: id.toUpperCase(), parameters }), aligned: true, sentence: null };
}

/** A view of two runs whose answers have not arrived yet. */
function asked() {
  const hub = new EventTarget();
  const view = new CompareView();
  /** @type {string[]} */
  const names = [];
  view.named = (name) => names.push(name);
  view.attach(/** @type {Hub} */ (/** @type {unknown} */ (hub)));
  view.show(["a", "b"]);
  return { hub, view, names };
}

test("an answer that arrives after the view was left does not name another view", async () => {
  serve((_, path) => answer(path));
  const { view, names } = asked();
  view.show([]);
  await settled();
  assert.deepEqual(names, []);
});

test("parameters that differ are named as in their fields", async () => {
  serve((_, path) => answer(path));
  const { view } = asked();
  await settled();
  const words = view.textContent ?? "";
  assert.ok(words.includes("Flow window size15 px21 px"), words);
  assert.ok(!words.includes(PARAMETER.name), words);
});

test("an error is gone once the runs could be read after all", async () => {
  serve(() => new Error("the server is starting"));
  const { hub, view, names } = asked();
  await settled();
  const error = view.children[0];
  assert.equal(error?.textContent, "The server is starting.");
  serve((_, path) => answer(path));
  hub.dispatchEvent(new Event("reconnected"));
  await settled();
  assert.deepEqual(names, ["Compare A and B"]);
  assert.equal(error?.textContent, "");
});
