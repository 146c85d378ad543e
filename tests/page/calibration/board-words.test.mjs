import assert from "node:assert/strict";
import { test } from "node:test";

import { boardDifference, boardInWords } from "../../../static/app/calibration/board-words.js";

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
