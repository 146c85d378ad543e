/** The first step: choose the board, its printed size and the cameras. */

import {
  button,
  download,
  field,
  h,
  icon,
  input,
  onSubmit,
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
import { Part } from "../elements/part.js";
import { counted } from "../elements/words.js";
import { request, requestImage } from "../shell/api.js";
import { attemptIn, askConfirmation } from "../shell/notice.js";
import { boardOf } from "../sources/choices.js";
import {
  boardDifference,
  boardInWords,
  MAX_BAR_MM,
  MIN_BAR_MM,
  scaleInWords,
  turnedInWords,
  wrongSizes,
} from "./board-words.js";

/** @import { BoardFacts, CalibratingFacts } from "../contract" */

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

export class BoardStep extends Part {
  /**
   * Called once the cameras are open or images have been uploaded.
   *
   * @type {(calibrating: CalibratingFacts) => void}
   */
  started = () => {};

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
  #lens = select({ id: "board-lens" }, [
    ["radtan", "Standard lens"],
    ["equidistant", "Fisheye lens"],
  ]);
  #source = input("text", "board-source", { spellcheck: "false" });
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
  #error = h("p.field-error", { role: "alert", id: "board-error" });
  #start = h("button.button.primary", { type: "submit" }, "Start with these cameras");
  #zip = input("file", "board-zip", {
    accept: ".zip",
    "aria-describedby": "board-zip-help board-zip-error",
  });
  #sending = h("p", { role: "status" });
  #unsent = h("p.field-error", { role: "alert", id: "board-zip-error" });
  #busy = false;
  #suggested = "";
  /** The board shown by the source itself. @type {BoardFacts | null} */
  #own = null;
  #ownSpec = "";

  build() {
    const form = h(
      "form.wizard-form",
      { novalidate: true },
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
      h(
        "fieldset.wizard-block",
        h("legend", "Choose cameras"),
        h("div.wizard-fields.wide", field("Cameras", this.#source), field("Lenses", this.#lens)),
        h(
          "p.hint",
          "camera:0,1 for two webcams, camera:sbs:0 for one side-by-side camera, or two rtsp:// or http:// addresses separated by a comma. The Source tab lists connected cameras.",
        ),
        this.#error,
        h("div.row", this.#start),
      ),
      h(
        "fieldset.wizard-block",
        h("legend", "Or upload images"),
        h(
          "label",
          { for: "board-zip" },
          "ZIP archive with folders left/ and right/ and the same file names in both",
        ),
        this.#zip,
        this.#sending,
        this.#unsent,
        h(
          "p.hint",
          { id: "board-zip-help" },
          "Every pair is searched for the board above. 15 to 30 pairs are enough.",
        ),
      ),
    );
    for (const each of [this.#columns, this.#rows, this.#square])
      setAttribute(each, "aria-describedby", this.#wrong.id);
    setAttribute(this.#bar, "aria-describedby", this.#wrongBar.id);
    this.append(form);
    this.#fill(storedChoice());
    form.addEventListener("input", () => this.#changed());
    // A source that shows its own board fills in the fields.
    this.#source.addEventListener("input", () => this.#followSource());
    onSubmit(form, () => this.#begin());
    this.#zip.addEventListener("change", () => void this.#sendImages());
    this.listen("status", () => this.#suggest());
    this.listen("sources", () => this.#followSource());
    this.listen("calibrate", () => {
      if (this.hub.uncalibrated) this.#source.value = this.hub.uncalibrated;
      this.#followSource();
    });
    this.#changed();
  }

  /** Return the choices made here that the computation needs. */
  computation() {
    return { distortion_model: this.#lens.value };
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

  /** Suggest the open source until the user types another one. */
  #suggest() {
    const open = this.hub.status?.source?.spec ?? "";
    if (open === this.#suggested || document.activeElement === this.#source) return;
    if (this.#source.value === this.#suggested) this.#source.value = open;
    this.#suggested = open;
    this.#followSource();
  }

  /** Fill in the board that the source shows; other sources bring back the user's own board. */
  #followSource() {
    const spec = this.#source.value.trim();
    const own = boardOf(this.hub.sources, spec);
    const same = JSON.stringify(own) === JSON.stringify(this.#own);
    this.#own = own;
    this.#ownSpec = spec;
    if (same) return this.#changed();
    if (own) this.#showBoard(own);
    else {
      this.#fill(storedChoice());
      this.#changed();
    }
  }

  /** @param {BoardFacts | null} board */
  #showBoard(board) {
    if (!board) return;
    const { kind, columns, rows, square_mm } = board;
    this.#fill({ kind, columns, rows, square_mm, paper: this.#paper.value });
    this.#changed();
  }

  #changed() {
    const c = this.#choice();
    // Remember only a printed board, not one shown by a source.
    if (!this.#own) localStorage.setItem(KEY, JSON.stringify(c));
    this.#compare(c);
    setText(this.#printing, "");
    this.#check(c);
  }

  /**
   * Mark the sizes that no board has, and say why.
   *
   * @param {BoardChoice} c
   * @returns {HTMLInputElement | null} the first of them
   */
  #check(c) {
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

  async #begin() {
    const wrong = this.#check(this.#choice());
    if (wrong) return wrong.focus();
    const { kind, columns, rows, ...rest } = this.#choice();
    const square_mm = squareOf({ kind, columns, rows, ...rest });
    const source = this.#source.value.trim() || null;
    const views = this.hub.status?.calibrating?.views.length ?? 0;
    const consequence = `This deletes ${counted(views, "captured view")}.`;
    if (
      views > 0 &&
      !(await askConfirmation("Start the calibration over?", consequence, "Start over"))
    )
      return;
    await this.#ask(this.#start, "Opening the cameras…", this.#error, async () => {
      /** @type {{calibrating: CalibratingFacts}} */
      const started = await request("POST", "/calibrating", {
        source,
        kind,
        columns,
        rows,
        square_mm,
      });
      this.hub.uncalibrated = "";
      return started;
    });
  }

  async #sendImages() {
    const file = this.#zip.files?.[0];
    if (!file) return;
    const choice = this.#choice();
    const wrong = this.#check(choice);
    if (wrong) {
      this.#zip.value = "";
      return wrong.focus();
    }
    const form = new FormData();
    form.append("file", file);
    for (const name of /** @type {const} */ (["kind", "columns", "rows"]))
      form.append(name, String(choice[name]));
    form.append("square_mm", String(squareOf(choice)));
    await this.#ask(this.#sending, "Finding the board in every image…", this.#unsent, () =>
      request("POST", "/calibrating/images", form),
    );
    this.#zip.value = "";
  }

  /**
   * @param {HTMLElement} place shows what is going on
   * @param {string} words
   * @param {HTMLElement} error shows why it failed
   * @param {() => Promise<{calibrating: CalibratingFacts}>} action
   */
  async #ask(place, words, error, action) {
    if (this.#busy) return;
    this.#busy = true;
    setText(error, "");
    const before = place.textContent ?? "";
    setText(place, words);
    // Not disabled: that would lose the focus.
    setAttribute(this.#start, "aria-disabled", "true");
    try {
      await attemptIn(error, async () => {
        this.started((await action()).calibrating);
      });
    } finally {
      this.#busy = false;
      setAttribute(this.#start, "aria-disabled", null);
      setText(place, before);
    }
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

customElements.define("observer-board-step", BoardStep);
