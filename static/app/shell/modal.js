/** Questions over the page: they cover everything, so each brings a stop button of its own. */

import { button } from "../elements/dom.js";

/**
 * Show a dialog over the page until it is closed. What stops the robots is seen in it while one is
 * armed.
 *
 * @param {HTMLDialogElement} dialog
 * @returns {Promise<string>} the value of the button that closed it, empty where none did
 */
export function showModal(dialog) {
  document.body.append(dialog);
  // The page behind the dialog takes no pointer, but its own stop button may be pressed for it.
  const stop = button(
    "Stop robots",
    () => /** @type {HTMLElement | null} */ (document.querySelector("#stop-robots"))?.click(),
    { class: "button danger dialog-stop" },
  );
  dialog.append(stop);
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue);
    });
  });
}
