/** Making a calibration step by step: the board, its views, the result. */

import { button, h, setAttribute, setText } from "../elements/dom.js";
import { focusHeading, restoreFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { counted } from "../elements/words.js";
import { access } from "../shell/access.js";
import { request } from "../shell/api.js";
import { attempt, askConfirmation, notify } from "../shell/notice.js";
import { openPane } from "../shell/splitter.js";
import { BoardStep } from "./board-step.js";
import { CaptureStep } from "./capture-step.js";
import { ResultStep } from "./result-step.js";

/** @import { Status } from "../contract" */

/** @typedef {"board" | "views" | "result"} Step */

/** @type {[Step, string][]} */
const STEPS = [
  ["board", "1 Board"],
  ["views", "2 Views"],
  ["result", "3 Result"],
];

/** Replaces the scene and the live views while calibrating. */
class CalibrationWizard extends Part {
  #steps = new Map(
    STEPS.map(([step, text]) => [step, button(text, null, { class: "wizard-step" })]),
  );
  #close = button("Exit", () => this.#leave());
  #title = h("h2", { tabindex: "-1", id: "wizard-title" }, "Calibrate");
  #board = new BoardStep();
  #views = new CaptureStep();
  #result = new ResultStep();
  /** @type {Step | null} null: nothing is being calibrated and the wizard is closed */
  #step = null;
  #computed = "";
  #computing = false;
  /** The source for which the wizard opened by itself. */
  #offered = "";
  /** The element that had the focus when the wizard was opened. @type {Element | null} */
  #caller = null;

  build() {
    this.#board.started = (calibrating) => {
      // An older status still on its way must not close a calibration that has just begun.
      const { status } = this.hub;
      if (status) this.hub.applyStatus({ ...status, calibrating });
      this.#go("views");
    };
    this.#views.compute = () => void this.#compute();
    this.#result.again = () => this.#go("views");
    this.#result.compute = () => {
      this.#go("views");
      void this.#compute();
    };
    this.#result.saved = () => void this.#saved();
    for (const [step, button] of this.#steps)
      button.addEventListener("click", () => this.#go(step));
    for (const part of [this.#board, this.#views, this.#result]) part.attach(this.hub);
    setAttribute(this, "role", "region");
    setAttribute(this, "aria-labelledby", "wizard-title");
    const steps = h(
      "ol.wizard-steps",
      ...[...this.#steps.values()].map((button) => h("li", button)),
    );
    this.append(
      h("header.wizard-head", this.#title, steps, this.#close),
      this.#board,
      this.#views,
      this.#result,
    );
    this.listen("status", () => this.#follow());
    this.listen("calibrate", () => {
      this.#caller = document.activeElement;
      this.#go(this.hub.status?.calibrating ? "views" : "board");
    });
    this.#follow();
  }

  /** Open, as the source's tile does, if the server was started with a source to calibrate. */
  async #offer() {
    const spec = this.hub.status?.to_calibrate ?? "";
    if (!spec || spec === this.#offered) return;
    this.#offered = spec;
    const away = this.#step !== null || document.body.hasAttribute("data-away");
    if (away || (await access()) !== "operator") return;
    this.hub.uncalibrated = spec;
    this.hub.emit("calibrate");
  }

  /** Follow a calibration that another page may have begun or ended. */
  #follow() {
    const { calibrating } = this.hub.status ?? {};
    void this.#offer();
    if (calibrating && this.#step === null) this.#go("views", false);
    if (!calibrating && (this.#step === "views" || this.#step === "result"))
      return this.#go(null, false);
    const computed = calibrating?.result?.join("|") ?? "";
    const computing = Boolean(calibrating?.computing);
    // The same views with another lens model give a new result under the same names.
    const done = this.#computing && !computing && !calibrating?.trouble && !this.#views.cancelled;
    const other = computed !== this.#computed || done;
    this.#computed = computed;
    this.#computing = computing;
    if (other && computed) {
      this.#result.renew();
      this.#go("result", false);
    }
    this.#render();
  }

  /**
   * @param {Step | null} step
   * @param {boolean} asked whether the person at this page asked for it
   */
  #go(step, asked = true) {
    const moved = step !== this.#step;
    // Do not take the focus from a user of the side panel because of what another page does.
    const away = !asked && document.activeElement?.closest("#panel, .header, dialog");
    this.#step = step;
    this.#render();
    if (!moved || away) return;
    if (step !== null) openPane("main");
    // The focus follows to the pane now shown.
    if (step !== null) focusHeading(this.#title);
    else restoreFocus(this.#caller);
  }

  async #saved() {
    // The new calibration is in use; an older status would show its views again.
    const status = await request("GET", "/status").catch(() => null);
    if (status) this.hub.applyStatus(/** @type {Status} */ (status));
    this.#go(null);
  }

  #render() {
    this.hidden = this.#step === null;
    setAttribute(document.body, "data-mode", this.#step === null ? null : "calibrating");
    this.#board.hidden = this.#step !== "board";
    this.#views.show(this.#step === "views");
    this.#result.show(this.#step === "result");
    const { calibrating } = this.hub.status ?? {};
    const words = STEPS.find(([step]) => step === this.#step)?.[1].slice(2) ?? "";
    const title = words ? `Calibrate: ${words}` : "Calibrate";
    if (this.#title.textContent !== title) {
      setText(this.#title, title);
      this.hub.emit("titled");
    }
    for (const [step, button] of this.#steps) {
      const possible =
        step === "board" ||
        (step === "views" ? Boolean(calibrating) : Boolean(calibrating?.result));
      setAttribute(button, "aria-current", step === this.#step ? "step" : null);
      button.disabled = !possible;
    }
  }

  async #compute() {
    this.#views.cancelled = false;
    await attempt(() => request("POST", "/calibrating/compute", this.#board.computation()));
  }

  async #leave() {
    const { calibrating } = this.hub.status ?? {};
    if (!calibrating) return this.#go(null);
    const views = calibrating.views.length;
    const question = "Exit calibration without saving?";
    const consequence = `This deletes ${counted(views, "captured view")} and any result computed from them.`;
    if (views > 0 && !(await askConfirmation(question, consequence, "Exit calibration"))) return;
    await attempt(async () => {
      this.hub.applyStatus(await request("DELETE", "/calibrating"));
      notify("Calibration cancelled. Nothing was changed.");
      this.#go(null);
    });
  }
}

customElements.define("observer-calibration-wizard", CalibrationWizard);
