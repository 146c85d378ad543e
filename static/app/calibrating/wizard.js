/** Making a calibration, step by step: a board, its views, what came of them. */

import { ApiError, request } from "../api.js";
import { h, setAttribute } from "../dom.js";
import { confirmed, notify, notifyError } from "../notice.js";
import { Part } from "../part.js";
import { BoardStep } from "./board-step.js";
import { CaptureStep } from "./capture-step.js";
import { ResultStep } from "./result-step.js";

/** @typedef {"board" | "views" | "result"} Step */

/** @type {[Step, string][]} */
const STEPS = [
  ["board", "1 Board"],
  ["views", "2 Views"],
  ["result", "3 Result"],
];

/** Takes the place of the scene and the live views while something is calibrated. */
class CalibrationWizard extends Part {
  #steps = h("ol", { class: "wizard-steps" });
  #close = h("button", { class: "button", type: "button" }, "Leave");
  #title = h("h2", { tabindex: "-1" }, "Calibrate");
  #board = new BoardStep();
  #views = new CaptureStep();
  #result = new ResultStep();
  /** @type {Step | null} null: nothing is calibrated and nobody wants to */
  #step = null;
  #computed = "";

  build() {
    this.#board.begun = () => this.#go("views");
    this.#views.compute = () => void this.#compute();
    this.#result.again = () => this.#go("views");
    this.#result.saved = () => this.#go(null);
    for (const part of [this.#board, this.#views, this.#result]) part.attach(this.hub);
    this.#close.addEventListener("click", () => void this.#leave());
    this.append(
      h("header", { class: "wizard-head" }, this.#title, this.#steps, this.#close),
      this.#board, this.#views, this.#result);
    this.hear("status", () => this.#follow());
    this.hear("calibrate", () => this.#go(this.hub.status?.calibrating ? "views" : "board"));
    this.#render();
  }

  /** What is calibrated may have been begun, or ended, by another page. */
  #follow() {
    const { calibrating } = this.hub.status ?? {};
    if (calibrating && this.#step === null) return this.#go("views");
    if (!calibrating && (this.#step === "views" || this.#step === "result")) return this.#go(null);
    const computed = calibrating?.result?.join("|") ?? "";
    if (computed !== this.#computed) {
      this.#computed = computed;
      if (computed) this.#go("result");
    }
    this.#render();
  }

  /** @param {Step | null} step */
  #go(step) {
    const moved = step !== this.#step;
    this.#step = step;
    this.#render();
    // The keyboard goes on where the eye does.
    if (moved && step !== null) this.#title.focus();
  }

  #render() {
    this.hidden = this.#step === null;
    setAttribute(document.body, "data-mode", this.#step === null ? null : "calibrating");
    this.#board.hidden = this.#step !== "board";
    this.#views.show(this.#step === "views");
    this.#result.show(this.#step === "result");
    const { calibrating } = this.hub.status ?? {};
    const words = STEPS.find(([step]) => step === this.#step)?.[1].slice(2) ?? "";
    this.#title.textContent = `Calibrate: ${words}`;
    this.#steps.replaceChildren(...STEPS.map(([step, text]) => {
      const possible = step === "board" || (step === "views" ? Boolean(calibrating) : Boolean(calibrating?.result));
      const button = h("button", { type: "button", class: "wizard-step", "aria-current": step === this.#step ? "step" : null, disabled: !possible }, text);
      button.addEventListener("click", () => this.#go(step));
      return h("li", {}, button);
    }));
  }

  async #compute() {
    try {
      await request("POST", "/calibrating/compute", this.#board.computation());
    } catch (error) {
      notifyError(error);
    }
  }

  async #leave() {
    const { calibrating } = this.hub.status ?? {};
    if (!calibrating) return this.#go(null);
    const views = calibrating.views.length;
    const question = "Leave without saving?";
    const consequence = `${views} captured view${views === 1 ? "" : "s"} and what was computed of them would be forgotten.`;
    if (views > 0 && !(await confirmed(question, consequence, "Leave"))) return;
    try {
      this.hub.takeStatus(await request("DELETE", "/calibrating"));
      notify("Calibrating ended; nothing was changed.");
      this.#go(null);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      notifyError(error);
    }
  }
}

customElements.define("observer-calibration-wizard", CalibrationWizard);
