import assert from "node:assert/strict";
import { test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { buttonOf, serve, settled } from "../fake-page.mjs";
import { run } from "../made.mjs";

const { AlignmentPanel } = await import("../../../static/app/runs/alignment-panel.js");

/** @param {string} id @param {object} [alignment] */
function chart(id, alignment) {
  const aligned = alignment !== undefined;
  const sentence = aligned ? "aligned" : null;
  return /** @type {any} */ ({ run: run({ id }), aligned, sentence, alignment, curves: [] });
}

const ALIGNMENT = {
  roles: { robot: "observer", cart: "obstacle" },
  matches: {},
  notes: [],
  camera_on_body: null,
  drift_sigma_ppm: null,
  offset_s: 0,
  sigma_s: 0.001,
  correlation: 0.99,
  frame_residual_m: null,
};

/** A panel, and how to let its alignment fail. */
async function panel() {
  /** @type {(answer: Error) => void} */
  let refuse = () => {};
  serve((method) => (method === "GET" ? [] : new Promise((resolve) => (refuse = resolve))));
  const made = new AlignmentPanel();
  made.attach(/** @type {any} */ (new Emitter()));
  made.show(chart("r1", ALIGNMENT));
  await settled();
  return { made, refuse: () => refuse(new Error("the tracks are too short")) };
}

test("a refused alignment is reported with its run only", async () => {
  const { made, refuse } = await panel();
  for (const id of ["r1", "r2"]) {
    buttonOf(made, "Align").fire("click");
    await settled();
    if (id === "r2") made.show(chart(id, ALIGNMENT));
    refuse();
    await settled();
    assert.equal(/too short/.test(String(made.textContent)), id === "r1");
    assert.equal(buttonOf(made, "Align").getAttribute("aria-disabled"), null);
  }
});

test("bodies stay as ticked while a running run is read again", async () => {
  const { made } = await panel();
  const boxes = () =>
    /** @type {any} */ (made)
      .querySelectorAll("input")
      .filter((/** @type {any} */ each) => each.getAttribute("type") === "checkbox");
  const [first] = boxes();
  made.show(chart("r1", structuredClone(ALIGNMENT)));
  assert.ok(boxes()[0] === first);
  made.show(chart("r1", { ...ALIGNMENT, roles: { robot: "observer" } }));
  assert.equal(boxes().length, 1);
});

test("ground truth on the run's own clock is read without bodies, and added instead of aligned", async () => {
  const info = { rate_hz: null, duration_s: 8, bodies: [], notes: ["it needs no alignment"] };
  const file = { id: "t1", name: "truth.csv", format: "truth.csv", created_at: "", info };
  serve((method) => (method === "GET" ? [file] : {}));
  const made = /** @type {any} */ (new AlignmentPanel());
  made.attach(/** @type {any} */ (new Emitter()));
  made.show({ ...chart("r1"), run: run({ truth_id: "t1" }) });
  await settled();
  assert.match(made.textContent, /Read as truth\.csv, 8\.0 s\.It needs no alignment\./);
  assert.ok(!made.textContent.includes("Extent"));
  buttonOf(made, "Add to run").fire("click");
  await settled();
  assert.match(made.textContent, /Added\. Recomputing the errors…/);
});
