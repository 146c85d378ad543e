/** The button that signs out this browser or all of them. */

import { button, h, icon } from "../elements/dom.js";
import { request } from "./api.js";
import { showModal } from "./modal.js";
import { attempt } from "./notice.js";
import { goToSignIn } from "./session.js";

/** The resource to delete. @type {Record<string, string>} */
const ENDS = { here: "/session", everywhere: "/sessions" };

class SignOut extends HTMLElement {
  connectedCallback() {
    if (this.childElementCount) return;
    this.append(button([icon("leave"), "Sign out"], () => this.#ask()));
  }

  async #ask() {
    const answer = await showModal(
      "question",
      "Sign out?",
      [
        h(
          "p",
          "You need the token to sign in again in this browser. A robot that it is driving stops.",
        ),
        h(
          "p.hint",
          "“Sign out everywhere” also signs out all other browsers, and the robots that they are driving stop.",
        ),
      ],
      h("button.button", { value: "" }, "Cancel"),
      h("button.button", { value: "everywhere", "data-changing": true }, "Sign out everywhere"),
      h("button.button.primary", { value: "here" }, "Sign out"),
    );
    const ended = ENDS[answer];
    if (ended && (await attempt(() => request("DELETE", ended)))) goToSignIn();
  }
}

customElements.define("observer-sign-out", SignOut);
