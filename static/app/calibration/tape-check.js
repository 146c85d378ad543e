/** Compares the stereo distance of a place with a tape measure and saves the result. */

import { button, h, input, setText } from "../elements/dom.js";
import { fixed } from "../elements/words.js";
import { request } from "../shell/api.js";
import { attemptIn } from "../shell/notice.js";

/** @import { Calibration } from "./report-parts.js" */

const STEP_PX = 8;

/** Works on the preview's canvas, whose left half is the rectified left image. */
export class TapeCheck {
  #path;
  #canvas;
  /** @type {[number, number] | null} */
  #place = null;
  #mark = h("span.place-mark", { hidden: true });
  // The canvas has no centre until the pair is painted.
  #centre = button(
    "Choose the image centre",
    () => this.#choose(this.#canvas.width / 4, this.#canvas.height / 2),
    { "aria-describedby": "tape-help", disabled: true },
  );
  #words = h("p", { role: "status" });
  #measured = input("number", "tape-measured", {
    min: 0.05,
    max: 100,
    step: "any",
    "aria-describedby": "tape-error",
  });
  #check = button("Compare", () => this.#compare());
  #error = h("p.field-error", { role: "alert", id: "tape-error" });
  #list = h("ul.plain-list");
  element = h("details.tape-check");

  /**
   * @param {Calibration} calibration
   * @param {HTMLCanvasElement} canvas
   */
  constructor(calibration, canvas) {
    this.#path = `/calibrations/${encodeURIComponent(calibration.id)}`;
    this.#canvas = canvas;
    this.element.append(
      h("summary", "Tape check"),
      h(
        "p.hint",
        { id: "tape-help" },
        "Click a flat, textured spot in the left image, or choose the image centre and move the mark with the arrow keys. Then measure the straight distance from the left lens to that spot.",
      ),
      h("div.row", this.#centre),
      this.#words,
      h(
        "div.row",
        h("label", { for: "tape-measured" }, "Tape measurement, m"),
        this.#measured,
        this.#check,
      ),
      this.#error,
      this.#list,
    );
    this.#centre.addEventListener("keydown", (event) => this.#move(event));
    canvas.addEventListener("click", (event) => this.#clicked(event));
    // Enter must compare, not close the dialog.
    this.#measured.addEventListener("keydown", (event) => {
      if (event.key !== "Enter") return;
      event.preventDefault();
      void this.#compare();
    });
    this.#show(calibration);
  }

  /** Allow choosing a place, now that the pair is painted. */
  begin() {
    this.#centre.disabled = false;
  }

  /** @param {MouseEvent} event */
  #clicked(event) {
    if (this.#centre.disabled) return;
    const box = this.#canvas.getBoundingClientRect();
    const u = ((event.clientX - box.left) / box.width) * this.#canvas.width;
    const v = ((event.clientY - box.top) / box.height) * this.#canvas.height;
    if (u < this.#canvas.width / 2) void this.#choose(u, v);
  }

  /** @param {KeyboardEvent} event */
  #move(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    /** @type {Record<string, [number, number]>} */
    const steps = {
      ArrowLeft: [-STEP_PX, 0],
      ArrowRight: [STEP_PX, 0],
      ArrowUp: [0, -STEP_PX],
      ArrowDown: [0, STEP_PX],
    };
    const step = steps[event.key];
    if (!step || !this.#place) return;
    event.preventDefault();
    void this.#choose(this.#place[0] + step[0], this.#place[1] + step[1]);
  }

  /** @param {number} u @param {number} v pixels of the canvas */
  async #choose(u, v) {
    const place = (this.#place = [
      Math.min(Math.max(u, 0), this.#canvas.width / 2 - 1),
      Math.min(Math.max(v, 0), this.#canvas.height - 1),
    ]);
    this.element.open = true;
    this.#drawMark();
    await attemptIn(this.#words, async () => {
      /** @type {{range_m: number}} */
      const { range_m } = await request("GET", `${this.#path}/depth?u=${place[0]}&v=${place[1]}`);
      if (this.#place === place) setText(this.#words, `Stereo distance: ${fixed(range_m, 3)} m.`);
    });
  }

  #drawMark() {
    if (!this.#place) return;
    if (!this.#mark.isConnected) {
      const holder = h("div.preview-image");
      this.#canvas.replaceWith(holder);
      holder.append(this.#canvas, this.#mark);
    }
    this.#mark.hidden = false;
    this.#mark.style.left = `${(100 * this.#place[0]) / this.#canvas.width}%`;
    this.#mark.style.top = `${(100 * this.#place[1]) / this.#canvas.height}%`;
  }

  async #compare() {
    setText(this.#error, "");
    const measured_m = Number(this.#measured.value);
    if (!this.#place) return setText(this.#error, "Choose a spot in the left image first.");
    if (!(measured_m > 0))
      return setText(this.#error, "Enter the measured distance in metres, for example 2.04.");
    const [u, v] = this.#place;
    await attemptIn(this.#error, async () => {
      this.#show(await request("POST", `${this.#path}/tape-checks`, { u, v, measured_m }));
    });
  }

  /** @param {Calibration} calibration */
  #show({ tape_checks }) {
    this.#list.replaceChildren(
      ...tape_checks.map((check) => h("li", `${check.at.slice(0, 10)}: ${check.sentence}`)),
    );
  }
}
