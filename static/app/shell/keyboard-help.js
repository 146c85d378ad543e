/** The dialog that lists the page's keys, opened by its button or "?". */

import { button, h, icon } from "../elements/dom.js";
import { declareKeys, declaredKeys, writesText } from "../elements/keys.js";
import { showModal } from "./modal.js";

declareKeys("Everywhere", ["?", "Show this list"]);

class KeyboardHelp extends HTMLElement {
  connectedCallback() {
    if (this.childElementCount) return;
    this.append(button([icon("keys"), "Keyboard"], () => showKeys()));
    window.addEventListener("keydown", (event) => {
      if (event.key !== "?" || event.ctrlKey || event.metaKey || event.altKey) return;
      const target = event.target instanceof HTMLElement ? event.target : document.body;
      if (event.defaultPrevented || writesText(target)) return;
      if (document.querySelector("dialog[open]")) return;
      event.preventDefault();
      void showKeys();
    });
  }
}

function showKeys() {
  const places = declaredKeys().map(([place, entries]) => [
    h("h3", place),
    h(
      "dl.key-list",
      ...entries.flatMap(({ keys, does }) => [
        h("dt", ...keys.flatMap((key, at) => [at ? " " : null, h("kbd", key)])),
        h("dd", does),
      ]),
    ),
  ]);
  return showModal(
    "question",
    "Keyboard",
    [h("div.key-lists", { tabindex: 0, role: "group", "aria-label": "Keys" }, ...places.flat())],
    h("button.button", { value: "", autofocus: true }, "Close"),
  );
}

customElements.define("observer-keyboard-help", KeyboardHelp);
