/** Questions over the page: they cover everything, so each brings a stop button of its own. */

import { button, h } from "../elements/dom.js";

/** @typedef {import("../elements/dom.js").Child} Child */

let shown = 0;

/**
 * Make a stop button for a dialog, which is seen while a robot is armed. The page behind takes no
 * pointer, but its own stop button may be pressed for it.
 */
export function stopCopy() {
  return button(
    "Stop robots",
    () => /** @type {HTMLElement | null} */ (document.querySelector("#stop-robots"))?.click(),
    { class: "button danger dialog-stop" },
  );
}

/**
 * Show a dialog over the page until it is closed. What stops the robots is seen in it while one is
 * armed.
 *
 * @param {"question" | "preview"} kind
 * @param {string} title
 * @param {Child[]} content
 * @param {...HTMLButtonElement} buttons each closes it with its value
 * @returns {Promise<string>} the value of the button that closed it, empty where none did
 */
export function showModal(kind, title, content, ...buttons) {
  const id = `dialog-${(shown += 1)}`;
  const dialog = h(
    "dialog",
    { class: kind, "aria-labelledby": id },
    h(
      "form",
      // Something half typed must not keep a preview open.
      { method: "dialog", novalidate: kind === "preview" },
      h("h2", { id }, title),
      ...content,
      h("div.row.end", ...buttons),
    ),
  );
  document.body.append(dialog);
  dialog.append(stopCopy());
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue);
    });
  });
}
