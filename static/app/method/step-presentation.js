/** One step in full screen and large type, with picture and formula, for lectures. */

import { button, h, icon, setText } from "../elements/dom.js";
import { stopCopy } from "../shell/modal.js";
import { formulaParts } from "./step-formula.js";
import { STEPS } from "./steps-address.js";

/** @import { MethodStep } from "../contract" */
/** @import { Hub } from "../shell/hub.js" */

const TITLE = "presented-title";

/**
 * A dialog over the page, in the browser's full screen. While a robot is armed full screen is not
 * used: Esc would leave it without reaching the page, so the robot would not stop.
 */
export class StepPresentation {
  #title = h("h2", { id: TITLE });
  #place = h("p.figure.presented-place");
  #image = h("img", { alt: "" });
  #formula = h("div.step-formula");
  #dialog = h("dialog.presentation", { "aria-labelledby": TITLE });
  #hub;
  // Whether this class is ending the full screen.
  #ending = false;

  /** Called with -1 or 1. @type {(by: number) => void} */
  stepped = () => {};

  /** @param {Hub} hub */
  constructor(hub) {
    this.#hub = hub;
    this.#dialog.append(
      h("div.presented-head", this.#place, this.#title),
      this.#image,
      this.#formula,
      h(
        "div.row.presented-keys",
        button("Previous step", () => this.stepped(-1)),
        button("Next step", () => this.stepped(1), { class: "button primary" }),
        button([icon("close"), "Exit"], () => this.close()),
      ),
      stopCopy(),
    );
    this.#dialog.addEventListener("close", () => void this.#closed());
    document.addEventListener("fullscreenchange", () => {
      const ended = document.fullscreenElement === null && !this.#ending;
      this.#ending = false;
      if (ended) this.close();
    });
    hub.addEventListener("robots", () => {
      if (this.isOpen && hub.driver.anyArmed) void this.#endFullScreen();
    });
  }

  get isOpen() {
    return this.#dialog.open;
  }

  open() {
    if (this.isOpen) return;
    document.body.append(this.#dialog);
    this.#dialog.showModal();
    // Without full screen the dialog covers the window.
    if (document.fullscreenEnabled && !this.#hub.driver.anyArmed)
      document.documentElement.requestFullscreen().catch(() => {});
  }

  close() {
    this.#dialog.close();
  }

  /** @param {MethodStep} step */
  update(step) {
    setText(this.#title, step.title);
    setText(this.#place, `${step.number} / ${STEPS}`);
    this.#formula.replaceChildren(...formulaParts(step));
  }

  /** @param {string} url @param {string} alt */
  show(url, alt) {
    this.#image.src = url;
    this.#image.alt = alt;
  }

  async #closed() {
    this.#dialog.remove();
    await this.#endFullScreen();
  }

  async #endFullScreen() {
    if (document.fullscreenElement === null) return;
    this.#ending = true;
    await document.exitFullscreen().catch(() => {});
  }
}
