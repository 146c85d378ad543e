/** Modal dialogs: they cover everything, so each has its own stop button. */

import { button, h } from "../elements/dom.js";
import { restoreFocus } from "../elements/focus.js";

/** @typedef {import("../elements/dom.js").Child} Child */

let shown = 0;

/**
 * Make a stop button for a dialog, visible while a robot is armed. The page behind does not accept
 * clicks, but its stop button can be triggered by script.
 */
export function stopCopy() {
  return button(
    "Stop robots",
    () => /** @type {HTMLElement | null} */ (document.querySelector("#stop-robots"))?.click(),
    { class: "button danger dialog-stop" },
  );
}

/**
 * Show a modal dialog until it is closed, with a stop button while a robot is armed.
 *
 * @param {"question" | "preview"} kind
 * @param {string} title
 * @param {Child[]} content
 * @param {...HTMLButtonElement} buttons each closes the dialog with its value
 * @returns {Promise<string>} the value of the button that closed it, empty if none did
 */
export function showModal(kind, title, content, ...buttons) {
  const id = `dialog-${(shown += 1)}`;
  const dialog = h(
    "dialog",
    { class: kind, "aria-labelledby": id },
    h(
      "form",
      // An invalid field must not keep a preview open.
      { method: "dialog", novalidate: kind === "preview" },
      h("h2", { id }, title),
      ...content,
      h("div.row.end", ...buttons),
    ),
  );
  const caller = document.activeElement;
  document.body.append(dialog);
  dialog.append(stopCopy());
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      // The browser gives the focus back, unless its element was made anew meanwhile.
      if (caller !== document.body && document.activeElement === document.body)
        restoreFocus(caller);
      resolve(dialog.returnValue);
    });
  });
}
