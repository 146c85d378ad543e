/** Boards in words. Pure functions. */

import {
  BAR_MM,
  MAX_SIDE_CORNERS,
  MAX_SQUARE_MM,
  MIN_SIDE_CORNERS,
  MIN_SQUARE_MM,
} from "../elements/facts.js";
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

/** @typedef {{kind: string, columns: number, rows: number, square_mm: number, bar_mm: number}} PrintedBoard */

/** Lengths of the printed bar that can be entered, mm. */
export const MIN_BAR_MM = 20;
export const MAX_BAR_MM = 300;
// A printer that fits the board to its page is off by less; more is a mistake in reading.
const MAX_BAR_SHARE = 0.1;

/**
 * Find what cannot be a board's size.
 *
 * @param {PrintedBoard} board 0 where nothing was entered
 * @returns {Partial<Record<"columns" | "rows" | "square_mm" | "bar_mm", string>>} a sentence each
 */
export function wrongSizes({ columns, rows, square_mm, bar_mm }) {
  /** @type {ReturnType<typeof wrongSizes>} */
  const wrong = {};
  const corners = `must be a whole number from ${MIN_SIDE_CORNERS} to ${MAX_SIDE_CORNERS}.`;
  const isSide = (/** @type {number} */ count) =>
    Number.isInteger(count) && count >= MIN_SIDE_CORNERS && count <= MAX_SIDE_CORNERS;
  if (!isSide(columns)) wrong.columns = `Columns ${corners}`;
  if (!isSide(rows)) wrong.rows = `Rows ${corners}`;
  if (!(square_mm >= MIN_SQUARE_MM && square_mm <= MAX_SQUARE_MM))
    wrong.square_mm = `Square must be from ${MIN_SQUARE_MM} to ${MAX_SQUARE_MM} mm.`;
  if (!(bar_mm >= MIN_BAR_MM && bar_mm <= MAX_BAR_MM))
    wrong.bar_mm = `Measure the bar and enter its length, from ${MIN_BAR_MM} to ${MAX_BAR_MM} mm.`;
  return wrong;
}

/** @param {Omit<PrintedBoard, "bar_mm">} board @returns {string} why it may be found turned; empty if it cannot be */
export function turnedInWords({ kind, columns, rows }) {
  if (kind !== "chessboard" || (columns + rows) % 2 === 1) return "";
  return `A board with ${columns} × ${rows} corners looks the same upside down, so the two cameras may read it differently. Use one even and one odd number.`;
}

/**
 * Say how large the printed squares are.
 *
 * @param {PrintedBoard} board
 * @returns {{words: string, doubtful: boolean}}
 */
export function scaleInWords({ square_mm, bar_mm }) {
  const scale = bar_mm / BAR_MM;
  if (Math.abs(bar_mm - BAR_MM) < 0.05)
    return { words: "The squares have the size printed on the board.", doubtful: false };
  const words = `A square measures ${fixed(square_mm * scale, 2)} mm. The calibration uses this size.`;
  if (Math.abs(bar_mm - BAR_MM) <= MAX_BAR_SHARE * BAR_MM) return { words, doubtful: false };
  const much = `${fixed(100 * Math.abs(scale - 1), 0)} % too ${scale < 1 ? "short" : "long"}`;
  return {
    words: `The bar is ${much}. Measure it again, or print the board at 100 %. ${words}`,
    doubtful: true,
  };
}

/** @param {number} mm */
function side(mm) {
  return String(Number(mm.toFixed(2)));
}
