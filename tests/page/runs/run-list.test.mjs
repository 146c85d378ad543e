import assert from "node:assert/strict";
import { test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { partOf, serve, settled } from "../fake-page.mjs";
import { run } from "../made.mjs";

await import("../../../static/app/runs/run-list.js");
const { RunView } = await import("../../../static/app/runs/run-view.js");

const FULL = run({ id: "full", name: "full" });
const EMPTY = run({ id: "empty", name: "empty", frames: 0, state: "failed" });

/** Attach a part to a page whose server has both runs. @param {any} part */
function attached(part) {
  serve((_, path) => {
    if (path.startsWith("/history")) return { runs: [FULL, EMPTY] };
    return path === "/runs/empty" ? EMPTY : [];
  });
  part.attach(Object.assign(new Emitter(), { status: { source: null, reruns: [] } }));
  return part;
}

test("the list offers speeds only of runs that have frames", async () => {
  const list = attached(partOf("observer-runs"));
  await settled();
  const [all, ...links] = list.querySelectorAll("a");
  assert.equal(all.getAttribute("href"), "#runs");
  const labels = links.map((/** @type {Element} */ each) => each.getAttribute("aria-label"));
  assert.deepEqual(labels.filter(Boolean), ["Speeds of run full as CSV"]);
});

test("a run without frames offers no export", async () => {
  const view = attached(new RunView());
  view.show("empty");
  await settled();
  await settled();
  const [files] = view.actions.children;
  assert.equal(files.hidden, true);
});
