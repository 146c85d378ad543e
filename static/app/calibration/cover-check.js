/** Checks the camera order: the user covers one lens, and the page says which image went dark. */

import { button, h, setText } from "../elements/dom.js";
import { moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { notifyError } from "../shell/notice.js";

export class CoverCheck extends Part {
  #ask = button("Check which camera is left", () => this.#change(true));
  #words = h("p", { role: "status" });
  #swap = button("Swap left and right", () => this.#swapCameras(), {
    class: "button primary",
    hidden: true,
  });
  #done = button("Done", () => this.#change(false), { hidden: true });

  build() {
    this.append(
      h("h3", "Camera order"),
      this.#words,
      h("div.row", this.#ask, this.#swap, this.#done),
    );
    this.listen("status", () => this.#render());
  }

  #render() {
    const look = this.hub.status?.calibrating?.look;
    const asked = look?.cover_asked ?? false;
    const covered = look?.covered ?? null;
    const [shown, taken] = asked ? [this.#done, this.#ask] : [this.#ask, this.#done];
    shown.hidden = false;
    moveFocus(taken, shown);
    taken.hidden = true;
    const swapped = covered === "right";
    if (!swapped) moveFocus(this.#swap, this.#done, this.#ask);
    this.#swap.hidden = !swapped;
    setText(this.#words, !asked ? "" : words(covered));
  }

  /** @param {boolean} asked */
  async #change(asked) {
    await request("PATCH", "/calibrating", { cover_check: asked }).catch(notifyError);
  }

  async #swapCameras() {
    await request("POST", "/calibrating/swap").catch(notifyError);
  }
}

/** @param {string | null} covered the side whose image went dark */
function words(covered) {
  if (covered === "left") return "Correct: the left image went dark. The cameras are not swapped.";
  if (covered === "right") return "The right image went dark: the cameras are swapped.";
  if (covered === "both") return "Both images went dark. Cover the left lens only.";
  return "Cover the left lens with your hand for a second. Left is as seen from behind the cameras.";
}

customElements.define("observer-cover-check", CoverCheck);
