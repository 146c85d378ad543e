import assert from "node:assert/strict";
import { test } from "node:test";

import { LastSeen } from "../../../static/app/elements/last-seen.js";
import { line, obstacle } from "../made.mjs";

test("the last measurement is kept while the obstacle is predicted, in its own segment only", () => {
  const lastSeen = new LastSeen();
  const coasting = obstacle({ state: "coasting", speed: 1.12 });
  lastSeen.take(line({ time: 1, obstacles: [obstacle({ speed: 0.4 })] }));
  lastSeen.take(line({ time: 2.5, obstacles: [coasting] }));
  assert.deepEqual(lastSeen.of(1), { speed: 0.4, speed_std: 0.02, ago_s: 1.5 });
  assert.equal(lastSeen.of(2), null);
  lastSeen.take(line({ time: 3, segment: 1, obstacles: [coasting] }));
  assert.equal(lastSeen.of(1), null);
});
