/** The stop button, always visible wherever the user is on the page, and its outcome. */

import { button, h, icon, setAttribute, setText } from "../elements/dom.js";
import { moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { attempt, notify } from "../shell/notice.js";
import { stopperInWords } from "./robot-words.js";
import { listenForStop } from "./stop-keys.js";

const WHAT_IT_IS_NOT = "Software stop, not a substitute for an emergency stop";
const WHAT_ELSE = "keep the hardware switch within reach";
const WHAT_IT_IS = `${WHAT_IT_IS_NOT}: ${WHAT_ELSE}`;
// Normally the answer takes a tenth of this; anything longer means trouble.
const CONFIRMED_MS = 1000;
const KEYS =
  "Space and Esc press it: everywhere while a robot is armed, otherwise outside fields and players.";
// Whoever presses Stop twice in a row must not reset what the first press stopped.
const NO_RESET_MS = 1000;

/** The button itself. It never moves, nor does anything next to it when robots are stopped. */
class StopBar extends Part {
  #stop = button([icon("stop"), h("span", "Stop", h("span.stop-word", " robots"))], null, {
    class: "stop-button",
    id: "stop-robots",
    title: `${WHAT_IT_IS}. ${KEYS}`,
    "aria-describedby": "stop-what",
    "aria-keyshortcuts": "Space Escape",
  });
  /** True while a stop pressed here has not been answered. */
  #pressed = false;
  #patience = 0;

  build() {
    const { driver } = this.hub;
    this.#stop.addEventListener("click", () => void driver.stop().catch(() => {}));
    this.append(this.#stop);
    listenForStop(driver);
    this.listen("stopping", () => this.#begin(), driver);
    this.listen(
      "stop-failed",
      () => this.#failed("The stop did not reach the server: use the hardware switch."),
      driver,
    );
    this.listen("robots", () => this.#mark(this.#pressed && !this.hub.robots?.stopped));
    this.listen("connection", () => this.#render());
    this.#render();
  }

  #begin() {
    clearTimeout(this.#patience);
    this.#mark(true);
    // A hanging server accepts the request but never answers.
    this.#patience = setTimeout(
      () => this.#failed("The server does not confirm the stop: use the hardware switch."),
      CONFIRMED_MS,
    );
  }

  /** @param {boolean} pressed */
  #mark(pressed) {
    if (!pressed) clearTimeout(this.#patience);
    this.#pressed = pressed;
    this.#render();
  }

  /** @param {string} words */
  #failed(words) {
    if (!this.#pressed) return;
    this.#mark(false);
    notify(words, "error");
  }

  #render() {
    const { driver } = this.hub;
    const robots = driver.anyArmed ? "armed" : driver.anyConnected ? "idle" : "none";
    setAttribute(document.documentElement, "data-robots", robots);
    setAttribute(this, "data-pressed", this.#pressed ? "" : null);
  }
}

/** The line below the header, away from the button: what stops armed robots, or who stopped them. */
class StopLine extends Part {
  #what = h(
    "p.stop-what",
    { id: "stop-what" },
    WHAT_IT_IS_NOT,
    h("span.stop-more", `: ${WHAT_ELSE}`),
  );
  #armed = h("div.stop-words", this.#what, h("p.stop-keys", "Space and Esc always stop"));
  #stopped = h("span.stop-state");
  #reset = button("Reset", () => this.#resetStop(), {
    title: "Allows robots to be armed again; none starts by itself",
    "data-changing": true,
  });
  #latched = h("div.stop-latched", { role: "alert" }, this.#stopped, this.#reset);
  #timer = 0;

  build() {
    this.#latched.hidden = true;
    this.append(this.#armed, this.#latched);
    this.listen("robots", () => this.#render());
    this.#render();
  }

  #render() {
    const { robots, driver } = this.hub;
    const stopped = robots?.stopped ?? null;
    setAttribute(document.documentElement, "data-stopped", stopped ? "" : null);
    if (stopped && this.#latched.hidden) this.#delayReset();
    // Nothing that the focus could move to is safer to press.
    if (!stopped) moveFocus(this.#latched, document.getElementById("stop-robots"));
    this.#latched.hidden = !stopped;
    this.#armed.hidden = stopped !== null || !driver.anyArmed;
    const who = stopped ? stopperInWords(stopped, driver.link.operator) : "";
    setText(this.#stopped, who);
    setAttribute(this.#stopped, "title", who || null);
  }

  #delayReset() {
    clearTimeout(this.#timer);
    setAttribute(this.#reset, "aria-disabled", "true");
    this.#timer = setTimeout(() => setAttribute(this.#reset, "aria-disabled", null), NO_RESET_MS);
  }

  async #resetStop() {
    if (this.#reset.getAttribute("aria-disabled")) return;
    await attempt(() => request("POST", "/robots/reset"));
  }
}

customElements.define("observer-stop", StopBar);
customElements.define("observer-stop-line", StopLine);
