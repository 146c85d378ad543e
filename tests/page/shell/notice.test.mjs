import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { FakeElement } from "../fake-page.mjs";

const { notify } = await import("../../../static/app/shell/notice.js");

const texts = (/** @type {FakeElement} */ host) =>
  host.children.map((each) => each.firstElementChild?.textContent);

test("a flood of notices covers no more than a corner: the newest stay", () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const host = new FakeElement("div");
  Object.assign(document, { querySelector: () => host });
  for (let n = 1; n <= 9; n += 1) notify(`Refused ${n}.`, "error");
  notify("Run deleted.", "done", { words: "Undo", act() {} });
  assert.deepEqual(texts(host), ["Refused 8.", "Refused 9.", "Run deleted."]);
});

test("an offer to undo stays while newer notices offer nothing", () => {
  const host = new FakeElement("div");
  Object.assign(document, { querySelector: () => host });
  const offer = { words: "Undo", act() {} };
  notify("Run deleted.", "done", offer);
  for (const name of ["Saved.", "Copied.", "Shared."]) notify(name);
  assert.deepEqual(texts(host), ["Run deleted.", "Copied.", "Shared."]);
  for (const name of ["a", "b", "c"]) notify(`Preset ${name} deleted.`, "done", offer);
  assert.deepEqual(
    texts(host),
    ["a", "b", "c"].map((name) => `Preset ${name} deleted.`),
  );
  notify("Saved.");
  assert.deepEqual(texts(host), ["Preset b deleted.", "Preset c deleted.", "Saved."]);
});
