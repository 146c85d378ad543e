import assert from "node:assert/strict";
import { test } from "node:test";

import { matrixOf, outlinesOf } from "../../../static/app/runs/map-cells.js";

/** @import { PlanMap } from "../../../static/app/contract" */

/** @type {PlanMap} */
const MAP = { first: 0, last: 9, corner: [1, 2, 0], cell_m: 0.1, size: 3, runs: [1, 3, 2, 0, 3] };

test("runs of cells are outlined row by row, also where one goes on in the next row", () => {
  // Rows along y: ? f f / f b b / f f f.
  assert.deepEqual(outlinesOf(MAP), {
    free: "M0 1h1v2h-1zM1 0h1v1h-1zM2 0h1v3h-1z",
    blocked: "M1 1h1v2h-1z",
  });
});

test("a map that lies as the drawing does has its x upwards and its y to the left", () => {
  const [a = 0, b = 0, c = 0, d = 0, e = 0, f = 0] = matrixOf(MAP, [200, 100], 50);
  const drawn = (/** @type {number} */ x, /** @type {number} */ y) => [
    a * x + c * y + e,
    b * x + d * y + f,
  ];
  assert.deepEqual(drawn(0, 0), [200, 100]);
  // Ten cells per metre.
  assert.deepEqual(drawn(10, 0), [200, 50]);
  assert.deepEqual(drawn(0, 10), [150, 100]);
});

test("a map that is turned to the left has its x to the left", () => {
  const [a = 0, b = 0] = matrixOf({ ...MAP, corner: [1, 2, Math.PI / 2] }, [0, 0], 50);
  assert.ok(Math.hypot(a + 5, b) < 1e-9);
});
