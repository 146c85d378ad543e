import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { buttonOf, serve, settled } from "../fake-page.mjs";
import { run } from "../made.mjs";

mock.timers.enable({ apis: ["setTimeout"] });
mock.method(performance, "now", () => 0);
Object.assign(globalThis, { createImageBitmap: async () => ({ close() {} }) });
const { MethodsSplit } = await import("../../../static/app/runs/methods-split.js");

/** A method that found nothing in four frames, 1 s apart. @param {string} name */
function method(name) {
  const frames = [0, 1, 2, 3].map((time) => ({ time, obstacles: [], truth: [], counts: null }));
  const found = { width: 4, height: 2, truth: false, observed_ms: null, frames };
  return /** @type {any} */ ({ run: run(), name, found });
}

test("pause and play in quick succession do not double the speed", async () => {
  serve(() => "image");
  const split = new MethodsSplit();
  split.attach(/** @type {any} */ ({}));
  split.show([method("paper"), method("default")]);
  buttonOf(split, "Pause").fire("click");
  buttonOf(split, "Play").fire("click");
  await settled();
  mock.timers.tick(1000);
  await settled();
  assert.match(String(split.textContent), /2 \/ 4/);
});
