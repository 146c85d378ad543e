/** The first step: choose the board, its printed size and the cameras. */

import { field, h, input, onSubmit, select, setAttribute, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { counted } from "../elements/words.js";
import { request } from "../shell/api.js";
import { attemptIn, askConfirmation } from "../shell/notice.js";
import { boardOf } from "../sources/choices.js";
import { BoardFields } from "./board-fields.js";

/** @import { CalibratingFacts } from "../contract" */

export class BoardStep extends Part {
  /**
   * Called once the cameras are open or images have been uploaded.
   *
   * @type {(calibrating: CalibratingFacts) => void}
   */
  started = () => {};

  #board = new BoardFields();
  #lens = select({ id: "board-lens" }, [
    ["radtan", "Standard lens"],
    ["equidistant", "Fisheye lens"],
  ]);
  #source = input("text", "board-source", { spellcheck: "false" });
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

  build() {
    const form = h(
      "form.wizard-form",
      { novalidate: true },
      ...this.#board.blocks,
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
    this.append(form);
    form.addEventListener("input", () => this.#board.changed());
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
    this.#board.changed();
  }

  /** Return the choices made here that the computation needs. */
  computation() {
    return { distortion_model: this.#lens.value };
  }

  /** Suggest the open source until the user types another one. */
  #suggest() {
    const open = this.hub.status?.source?.spec ?? "";
    if (open === this.#suggested || document.activeElement === this.#source) return;
    if (this.#source.value === this.#suggested) this.#source.value = open;
    this.#suggested = open;
    this.#followSource();
  }

  /** Show the board that the chosen source shows, if it does. */
  #followSource() {
    const spec = this.#source.value.trim();
    this.#board.follow(boardOf(this.hub.sources, spec), spec);
  }

  async #begin() {
    const wrong = this.#board.check();
    if (wrong) return wrong.focus();
    const board = this.#board.printed();
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
      const started = await request("POST", "/calibrating", { source, ...board });
      this.hub.uncalibrated = "";
      return started;
    });
  }

  async #sendImages() {
    const file = this.#zip.files?.[0];
    if (!file) return;
    const wrong = this.#board.check();
    if (wrong) {
      this.#zip.value = "";
      return wrong.focus();
    }
    const form = new FormData();
    form.append("file", file);
    for (const [name, value] of Object.entries(this.#board.printed()))
      form.append(name, String(value));
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

customElements.define("observer-board-step", BoardStep);
