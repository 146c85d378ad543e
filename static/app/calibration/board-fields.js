/** The board's fields: its kind, size and paper, and the scale at which it was printed. */

import {
  button,
  download,
  field,
  h,
  icon,
  input,
  select,
  setAttribute,
  setText,
} from "../elements/dom.js";
import {
  A4_COLUMNS,
  A4_ROWS,
  A4_SQUARE_MM,
  BAR_MM,
  MAX_SIDE_CORNERS,
  MAX_SQUARE_MM,
  MIN_SIDE_CORNERS,
  MIN_SQUARE_MM,
} from "../elements/facts.js";
import { moveFocus } from "../elements/focus.js";
import { requestImage } from "../shell/api.js";
import { attemptIn } from "../shell/notice.js";
import {
  boardDifference,
  boardInWords,
  MAX_BAR_MM,
  MIN_BAR_MM,
  scaleInWords,
  turnedInWords,
  wrongSizes,
} from "./board-words.js";

/** @import { BoardFacts } from "../contract" */

const KEY = "dynamic-observer.board";

/** @typedef {{kind: string, columns: number, rows: number, square_mm: number, paper: string, bar_mm: number}} BoardChoice */

/** @type {BoardChoice} */
const DEFAULT_BOARD = {
  kind: "chessboard",
  columns: A4_COLUMNS,
  rows: A4_ROWS,
  square_mm: A4_SQUARE_MM,
  paper: "A4",
  bar_mm: BAR_MM,
};

export class BoardFields {
  #kind = select({ id: "board-kind" }, [
    ["chessboard", "Chessboard"],
    ["charuco", "ChArUco (may be partly visible)"],
  ]);
  #columns = number("board-columns", MIN_SIDE_CORNERS, MAX_SIDE_CORNERS, 1);
  #rows = number("board-rows", MIN_SIDE_CORNERS, MAX_SIDE_CORNERS, 1);
  #square = number("board-square", MIN_SQUARE_MM, MAX_SQUARE_MM, "any");
  #paper = select({ id: "board-paper" }, [
    ["A4", "A4"],
    ["A3", "A3"],
    ["Letter", "US Letter"],
  ]);
  #bar = number("board-bar", MIN_BAR_MM, MAX_BAR_MM, "any");
  #svg = button([icon("download"), "Board as SVG"], () => this.#download("svg"));
  #pdf = button([icon("download"), "Board as PDF"], () => this.#download("pdf"));
  #ownWords = h("p", { role: "status", hidden: true });
  #wrong = h("p.field-error", { role: "status", id: "board-wrong" });
  #turned = h("p.warnings", { role: "status" });
  #wrongBar = h("p.field-error", { role: "status", id: "board-bar-wrong" });
  #otherBoard = h("p.warnings", { role: "status", id: "board-other" });
  #useOwn = button("Use the source's board", () => this.#showBoard(this.#own), { hidden: true });
  #printing = h("p.field-error", { role: "alert" });
  #scaled = h("p.hint", { role: "status" });
  /** The board shown by the source itself. @type {BoardFacts | null} */
  #own = null;
  #ownSpec = "";

  /** The parts of the form in which a board is chosen. */
  blocks = [
    h(
      "fieldset.wizard-block",
      h("legend", "Print a board"),
      this.#ownWords,
      h(
        "p.hint",
        "Count the inner corners, where four squares meet, not the squares. Use more columns than rows, one even and one odd, so that the board's orientation is unambiguous.",
      ),
      h(
        "div.wizard-fields",
        field("Kind", this.#kind),
        field("Columns", this.#columns),
        field("Rows", this.#rows),
        field("Square, mm", this.#square),
        field("Paper", this.#paper),
      ),
      this.#wrong,
      this.#turned,
      this.#otherBoard,
      h("div.row", this.#pdf, this.#svg, this.#useOwn),
      this.#printing,
      h(
        "p.hint",
        "Print at 100 %, not “fit to page”, and glue the sheet to something flat and stiff: glass, a door, a clipboard.",
      ),
    ),
    h(
      "fieldset.wizard-block",
      h("legend", "Check the print scale"),
      h(
        "div.wizard-fields.single",
        field(`Measured length of the ${BAR_MM} mm bar, mm`, this.#bar),
      ),
      this.#wrongBar,
      this.#scaled,
    ),
  ];

  constructor() {
    for (const each of [this.#columns, this.#rows, this.#square])
      setAttribute(each, "aria-describedby", this.#wrong.id);
    setAttribute(this.#bar, "aria-describedby", this.#wrongBar.id);
    this.#fill(storedChoice());
  }

  /** Return the board as printed: what the server is asked to find. */
  printed() {
    const choice = this.#choice();
    const { kind, columns, rows } = choice;
    return { kind, columns, rows, square_mm: squareOf(choice) };
  }

  /** @param {Partial<BoardChoice>} chosen */
  #fill(chosen) {
    const choice = { ...DEFAULT_BOARD, ...chosen };
    this.#kind.value = choice.kind;
    this.#columns.value = String(choice.columns);
    this.#rows.value = String(choice.rows);
    this.#square.value = String(choice.square_mm);
    this.#paper.value = choice.paper;
    this.#bar.value = String(choice.bar_mm);
  }

  /**
   * Fill in the board that a source shows; other sources bring back the user's own board.
   *
   * @param {BoardFacts | null} own
   * @param {string} spec
   */
  follow(own, spec) {
    const same = JSON.stringify(own) === JSON.stringify(this.#own);
    this.#own = own;
    this.#ownSpec = spec;
    if (same) return this.changed();
    if (own) this.#showBoard(own);
    else {
      this.#fill(storedChoice());
      this.changed();
    }
  }

  /** @param {BoardFacts | null} board */
  #showBoard(board) {
    if (!board) return;
    const { kind, columns, rows, square_mm } = board;
    this.#fill({ kind, columns, rows, square_mm, paper: this.#paper.value });
    this.changed();
  }

  /** Take over what was typed. */
  changed() {
    const c = this.#choice();
    // Remember only a printed board, not one shown by a source.
    if (!this.#own) localStorage.setItem(KEY, JSON.stringify(c));
    this.#compare(c);
    setText(this.#printing, "");
    this.check();
  }

  /**
   * Mark the sizes that no board has, and say why.
   *
   * @returns {HTMLInputElement | null} the first of them
   */
  check() {
    const c = this.#choice();
    const wrong = wrongSizes(c);
    const { bar_mm: bar, ...sizes } = wrong;
    const fields = {
      columns: this.#columns,
      rows: this.#rows,
      square_mm: this.#square,
      bar_mm: this.#bar,
    };
    for (const [name, input] of Object.entries(fields))
      setAttribute(input, "aria-invalid", name in wrong ? "true" : null);
    setText(this.#wrong, Object.values(sizes).join(" "));
    setText(this.#wrongBar, bar ?? "");
    const isWrong = Object.keys(wrong).length > 0;
    setText(this.#turned, isWrong ? "" : turnedInWords(c));
    const { words, doubtful } = scaleInWords(c);
    setText(this.#scaled, isWrong ? "" : words);
    this.#scaled.classList.toggle("warnings", doubtful);
    this.#scaled.classList.toggle("hint", !doubtful);
    return Object.entries(fields).find(([name]) => name in wrong)?.[1] ?? null;
  }

  /** Say which board the source shows and whether another one is chosen. @param {BoardChoice} c */
  #compare(c) {
    const own = this.#own;
    this.#ownWords.hidden = own === null;
    setText(
      this.#ownWords,
      own
        ? `${this.#ownSpec} shows a board of its own: ${boardInWords(own)}. It is filled in below, and there is nothing to print.`
        : "",
    );
    const difference = own ? boardDifference(own, { ...c, square_mm: squareOf(c) }) : "";
    setText(this.#otherBoard, difference);
    if (!difference) moveFocus(this.#useOwn, this.#square);
    this.#useOwn.hidden = !difference;
  }

  /** @returns {BoardChoice} */
  #choice() {
    return {
      kind: this.#kind.value,
      columns: Number(this.#columns.value),
      rows: Number(this.#rows.value),
      square_mm: Number(this.#square.value),
      paper: this.#paper.value,
      bar_mm: Number(this.#bar.value),
    };
  }

  /** @param {"svg" | "pdf"} format a board that does not fit the paper is refused in words */
  async #download(format) {
    const c = this.#choice();
    const query = new URLSearchParams({
      columns: String(c.columns),
      rows: String(c.rows),
      square_mm: String(c.square_mm),
      paper: c.paper,
    });
    setText(this.#printing, "");
    await attemptIn(this.#printing, async () => {
      const { blob } = await requestImage(`/boards/${c.kind}.${format}?${query}`);
      download(blob, `board-${c.kind}-${c.columns}x${c.rows}-${c.square_mm}mm.${format}`);
    });
  }
}

/** @param {BoardChoice} choice @returns {number} the printed square's side, mm */
function squareOf({ square_mm, bar_mm }) {
  return (square_mm * bar_mm) / BAR_MM;
}

/** @returns {Partial<BoardChoice>} */
function storedChoice() {
  try {
    return JSON.parse(localStorage.getItem(KEY) ?? "{}");
  } catch {
    return {};
  }
}

/** @param {string} id @param {number} min @param {number} max @param {number | "any"} step */
function number(id, min, max, step) {
  return input("number", id, { min, max, step, required: true });
}
