import assert from "node:assert/strict";
import { test } from "node:test";

import { FakeElement, partOf } from "../fake-page.mjs";

const { TapeCheck } = await import("../../../static/app/calibration/tape-check.js");
const { PixelQuestion } = await import("../../../static/app/live/pixel-question.js");
await import("../../../static/app/shell/side-tabs.js");
await import("../../../static/app/shell/splitter.js");

/** @param {unknown} element */
function leavesTheBrowsersKeys(element) {
  const { fire } = FakeElement.prototype;
  const handled = (/** @type {object} */ more) =>
    fire.call(element, "keydown", { key: "ArrowLeft", ...more }).defaultPrevented;
  for (const modifier of ["altKey", "ctrlKey", "metaKey"])
    assert.ok(!handled({ [modifier]: true }), modifier);
  assert.ok(handled({}));
}

test("tabs leave the browser's keys, such as Alt+Left, alone", () => {
  const tabs = partOf("observer-tabs");
  const tab = new FakeElement("button");
  tab.setAttribute("role", "tab");
  tabs.append(tab);
  tabs.connectedCallback();
  leavesTheBrowsersKeys(tab);
});

test("the bar between panes leaves the browser's keys alone", () => {
  const bar = partOf("observer-splitter");
  bar.connectedCallback();
  leavesTheBrowsersKeys(bar.children[0]);
});

test("the mark of a pixel leaves the browser's keys alone", () => {
  const question = new PixelQuestion();
  question.attach(/** @type {any} */ (Object.assign(new EventTarget(), { status: null })));
  leavesTheBrowsersKeys(question.pick);
});

test("the place of a tape check leaves the browser's keys alone", () => {
  const canvas = Object.assign(new FakeElement("canvas"), { width: 8, height: 4 });
  const calibration = { id: "c1", tape_checks: [] };
  const { element } = new TapeCheck(/** @type {any} */ (calibration), /** @type {any} */ (canvas));
  const [centre] = /** @type {FakeElement} */ (/** @type {unknown} */ (element)).querySelectorAll(
    "button",
  );
  centre?.fire("click");
  leavesTheBrowsersKeys(centre);
});
