import assert from "node:assert/strict";
import { test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { buttonOf, serve, settled } from "../fake-page.mjs";
import { run } from "../made.mjs";

const { RunLabels } = await import("../../../static/app/runs/run-labels.js");

test("two tags removed in quick succession stay removed", async () => {
  let stored = run({ tags: ["a", "b", "c"] });
  serve(async (_, __, change) => {
    await settled();
    return (stored = { ...stored, ...change });
  });
  const labels = new RunLabels();
  labels.attach(/** @type {any} */ (new Emitter()));
  labels.show(stored);
  buttonOf(labels, "Remove tag a").fire("click");
  buttonOf(labels, "Remove tag b").fire("click");
  for (let turn = 0; turn < 10; turn++) await settled();
  assert.deepEqual(stored.tags, ["c"]);
});
