import assert from "node:assert/strict";
import { test } from "node:test";

import * as words from "../../../static/app/calibration/board-words.js";

const { boardDifference, boardInWords } = words;

const SHOWN = /** @type {const} */ ({ kind: "chessboard", columns: 9, rows: 6, square_mm: 25 });

test("a board is told by its corners and its squares", () => {
  assert.equal(boardInWords(SHOWN), "a chessboard with 9 × 6 inner corners and 25 mm squares");
});

test("squares of another size are told with what they do to all distances", () => {
  assert.equal(boardDifference(SHOWN, { ...SHOWN }), "");
  assert.match(
    boardDifference(SHOWN, { ...SHOWN, square_mm: 21 }),
    /measure 25 mm, not 21 mm\. .* 16 % too small\./,
  );
  assert.match(boardDifference(SHOWN, { ...SHOWN, square_mm: 25.5 }), /2\.0 % too large/);
});

test("another board is not found at all", () => {
  for (const other of [{ kind: "charuco" }, { columns: 8 }, { rows: 5 }])
    assert.match(boardDifference(SHOWN, { ...SHOWN, ...other }), /will not be found/);
});

test("sizes that no board has are told one by one, with the limits", () => {
  const board = { ...SHOWN, bar_mm: 100 };
  assert.deepEqual(words.wrongSizes(board), {});
  for (const columns of [0, 1, 500, 4.5])
    assert.match(String(words.wrongSizes({ ...board, columns }).columns), /^Columns must be/);
  assert.match(String(words.wrongSizes({ ...board, bar_mm: 0 }).bar_mm), /^Measure the bar/);
});

test("a board that looks the same upside down is warned of, unless its squares are numbered", () => {
  const square = { ...SHOWN, columns: 7, rows: 7 };
  assert.match(words.turnedInWords(square), /^A board with 7 × 7 corners looks the same/);
  assert.equal(words.turnedInWords({ ...square, kind: "charuco" }), "");
  assert.equal(words.turnedInWords(SHOWN), "");
});

test("a bar more than 10 % off is doubted", () => {
  const told = (/** @type {number} */ bar_mm) => words.scaleInWords({ ...SHOWN, bar_mm });
  assert.deepEqual(
    [100, 96, 110].map((bar) => told(bar).doubtful),
    [false, false, false],
  );
  assert.equal(
    told(50).words,
    "The bar is 50 % too short. Measure it again, or print the board at 100 %. A square measures 12.50 mm. The calibration uses this size.",
  );
  assert.ok(told(50).doubtful && told(120).doubtful);
});
