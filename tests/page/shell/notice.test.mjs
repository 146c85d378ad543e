import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { FakeElement } from "../fake-page.mjs";

const { notify } = await import("../../../static/app/shell/notice.js");

test("a flood of notices covers no more than a corner: the newest stay", () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const host = new FakeElement("div");
  Object.assign(document, { querySelector: () => host });
  for (let n = 1; n <= 9; n += 1) notify(`Refused ${n}.`, "error");
  notify("Run deleted.", "done", { words: "Undo", act() {} });
  const texts = host.children.map((each) => each.firstElementChild?.textContent);
  assert.deepEqual(texts, ["Refused 8.", "Refused 9.", "Run deleted."]);
});
