/** Questions over the page: they cover everything, so each brings a stop button of its own. */

import { h } from "../dom.js";

/**
 * Show a dialog over the page. What stops the robots is seen in it while one is armed.
 *
 * @param {HTMLDialogElement} dialog already within the page
 */
export function showModal(dialog) {
  const stop = h("button.button.danger.dialog-stop", { type: "button" }, "Stop robots");
  // The page behind the dialog takes no pointer, but its own stop button may be pressed for it.
  stop.addEventListener("click", () =>
    /** @type {HTMLElement | null} */ (document.querySelector("#stop-robots"))?.click(),
  );
  dialog.append(stop);
  dialog.showModal();
}
