import assert from "node:assert/strict";
import { test } from "node:test";

import { placeLabels } from "../../../static/app/elements/label-places.js";

const IMAGE = { width: 100, height: 60 };

/** @param {number} x @param {number} y */
function label(x, y) {
  return { x, y, width: 40, height: 10 };
}

/** @param {import("../../../static/app/elements/label-places.js").Area[]} wanted */
function corners(wanted) {
  return placeLabels(wanted, IMAGE).map(({ x, y }) => [x, y]);
}

test("labels with room stay where they are wanted", () => {
  assert.deepEqual(corners([label(0, 20), label(50, 22), label(0, 30)]), [
    [0, 20],
    [50, 22],
    [0, 30],
  ]);
});

test("a label that would cover another goes to the nearest free row", () => {
  assert.deepEqual(corners([label(0, 20), label(20, 18)]), [
    [0, 20],
    [20, 10],
  ]);
  assert.deepEqual(corners([label(0, 20), label(20, 22)]), [
    [0, 20],
    [20, 30],
  ]);
});

test("labels stay within the image, the next ones below those at its upper edge", () => {
  assert.deepEqual(corners([label(-5, -8), label(80, 0), label(55, -3), label(50, -2)]), [
    [0, 0],
    [60, 0],
    [55, 10],
    [50, 20],
  ]);
});

test("in a crowd without room, a label is where it is wanted", () => {
  const rows = [0, 10, 20, 30, 40, 50].map((y) => label(0, y));
  assert.deepEqual(corners([...rows, label(10, 25)]).at(-1), [10, 25]);
});
