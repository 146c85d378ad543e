import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { serve, settled } from "../fake-page.mjs";

mock.timers.enable({ apis: ["setTimeout"] });
const { ResultStep } = await import("../../../static/app/calibration/result-step.js");

test("a result that could not be read is reported and asked for again after a pause", async () => {
  let asked = 0;
  serve(() => {
    asked += 1;
    return new Error("the engine is restarting");
  });
  const hub = Object.assign(new Emitter(), {
    status: { calibrating: { result: ["1"], views: [{ name: "1" }], source: null } },
  });
  const step = new ResultStep();
  step.attach(/** @type {any} */ (hub));
  step.show(true);
  for (let status = 0; status < 3; status++) {
    await settled();
    hub.emit("status");
  }
  assert.match(String(step.textContent), /^The engine is restarting\./);
  assert.equal(asked, 1);
  mock.timers.tick(10_000);
  await settled();
  assert.equal(asked, 2);
});
