/** The stop button, always visible wherever the user is on the page, and its outcome. */

import { button, h, icon, setAttribute, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { attempt, notify } from "../shell/notice.js";
import { listenForStop } from "./stop-keys.js";

const WHAT_IT_IS =
  "Software stop, not a substitute for an emergency stop: keep the hardware switch within reach";
// Normally the answer takes a tenth of this; anything longer means trouble.
const CONFIRMED_MS = 1000;
const KEYS = "Space and Esc press it; while a robot is armed, they do so everywhere on this page.";

class StopBar extends Part {
  #stop = button([icon("stop"), h("span", "Stop", h("span.stop-word", " robots"))], null, {
    class: "stop-button",
    id: "stop-robots",
    title: `${WHAT_IT_IS}. ${KEYS}`,
    "aria-describedby": "stop-what",
    "aria-keyshortcuts": "Space Escape",
  });
  #what = h("p.stop-what", { id: "stop-what" }, WHAT_IT_IS);
  #keys = h("p.stop-keys");
  #stopped = h("span.stop-state");
  #reset = button("Reset", () => this.#resetStop(), {
    title: "Allows robots to be armed again; none starts by itself",
    "data-changing": true,
  });
  #latched = h("div.stop-latched", { hidden: true, role: "alert" }, this.#stopped, this.#reset);
  /** True while a stop pressed here has not been answered. */
  #pressed = false;
  #patience = 0;

  build() {
    const { driver } = this.hub;
    this.#stop.addEventListener("click", () => void driver.stop().catch(() => {}));
    this.append(this.#latched, h("div.stop-words", this.#what, this.#keys), this.#stop);
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
    const { robots, driver } = this.hub;
    const stopped = robots?.stopped ?? null;
    const robotsState = driver.anyArmed ? "armed" : driver.anyConnected ? "idle" : "none";
    setAttribute(document.documentElement, "data-robots", robotsState);
    setAttribute(this, "data-stopped", stopped ? "" : null);
    setAttribute(this, "data-pressed", this.#pressed ? "" : null);
    this.#latched.hidden = !stopped;
    setText(this.#stopped, stopped ? `Stopped by ${stopped.by}` : "");
    setAttribute(this.#stopped, "title", stopped ? `Stopped by ${stopped.by}` : null);
    setText(
      this.#keys,
      robotsState === "armed" ? "Armed: Space and Esc always stop" : "Space or Esc",
    );
  }

  async #resetStop() {
    await attempt(() => request("POST", "/robots/reset"));
  }
}

customElements.define("observer-stop", StopBar);
