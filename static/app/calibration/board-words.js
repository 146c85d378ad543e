/** Boards in words. Pure functions. */

import { fixed } from "../elements/words.js";

/** @import { BoardFacts } from "../contract" */

/** @typedef {Pick<BoardFacts, "kind" | "columns" | "rows" | "square_mm">} BoardSize */

/** @type {Record<string, string>} */
const KINDS = { chessboard: "chessboard", charuco: "ChArUco board" };

/** @param {BoardSize} board */
export function boardInWords({ kind, columns, rows, square_mm }) {
  return `a ${KINDS[kind] ?? kind} with ${columns} × ${rows} inner corners and ${side(square_mm)} mm squares`;
}

/**
 * What goes wrong if the chosen board differs from the one that the cameras see.
 *
 * @param {BoardSize} shown
 * @param {{kind: string, columns: number, rows: number, square_mm: number}} chosen
 * @returns {string} one or two sentences; empty if they are the same
 */
export function boardDifference(shown, chosen) {
  const alike = (/** @type {"kind" | "columns" | "rows"} */ key) => shown[key] === chosen[key];
  if (!alike("kind") || !alike("columns") || !alike("rows"))
    return `The source shows ${boardInWords(shown)}. Another board will not be found.`;
  const scale = chosen.square_mm / shown.square_mm;
  if (!Number.isFinite(scale) || Math.abs(scale - 1) < 5e-4) return "";
  const percent = 100 * Math.abs(scale - 1);
  const much = `${fixed(percent, percent < 10 ? 1 : 0)} % too ${scale < 1 ? "small" : "large"}`;
  return `The squares of the source's board measure ${side(shown.square_mm)} mm, not ${side(chosen.square_mm)} mm. The baseline and all distances would be ${much}.`;
}

/** @param {number} mm */
function side(mm) {
  return String(Number(mm.toFixed(2)));
}
