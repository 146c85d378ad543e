/** Space and Esc stop the robots. */

import { declareKeys, writesText } from "../elements/keys.js";

declareKeys("Everywhere", ["Space Esc", "Stop all robots"]);

// What Space presses or Esc leaves, where no robot is armed.
const OWN_SPACE = 'button, summary, select, input, a, [role="tab"], [contenteditable]';
// What Esc closes there, though the focus stays on the button that opened it.
const MENU = ':popover-open:not([popover="manual"])';

/**
 * Have Space and Esc stop.
 *
 * While a robot is armed they always do, also where one types or a button has the focus, and do
 * nothing else. Otherwise they keep the meaning they have in fields, buttons and dialogs, and stop
 * everywhere else, as long as there is a robot.
 *
 * @param {import("./driver.js").Driver} driver
 */
export function listenForStop(driver) {
  let taken = "";
  window.addEventListener(
    "keydown",
    (event) => {
      if (!isStop(event) || !driver.anyArmed) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      taken = event.code;
      if (!event.repeat) void driver.stop().catch(() => {});
    },
    { capture: true },
  );
  // A button is pressed at the release of Space.
  window.addEventListener(
    "keyup",
    (event) => {
      if (event.code !== taken) return;
      taken = "";
      event.preventDefault();
      event.stopImmediatePropagation();
    },
    { capture: true },
  );
  // Behind everything else that wants these keys.
  window.addEventListener("keydown", (event) => {
    if (!isStop(event) || event.defaultPrevented || event.repeat || !driver.anyConnected) return;
    const target = /** @type {HTMLElement | null} */ (event.target);
    if (target?.closest?.("dialog, [popover]") || (target && target.tagName && writesText(target)))
      return;
    if (event.code === "Space" && target?.closest?.(OWN_SPACE)) return;
    if (event.key === "Escape" && document.querySelector(MENU)) return;
    event.preventDefault();
    void driver.stop().catch(() => {});
  });
}

/** @param {KeyboardEvent} event */
function isStop(event) {
  return (
    (event.code === "Space" || event.key === "Escape") &&
    !event.ctrlKey &&
    !event.metaKey &&
    !event.altKey
  );
}
