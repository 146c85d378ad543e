/** Space and Esc stop the robots. */

import { declareKeys, usesSpace, writesText } from "../elements/keys.js";

declareKeys("Everywhere", ["Space Esc", "Stop all robots while one is armed, even while you type"]);
declareKeys("Everywhere except in fields, menus and dialogs", [
  "Space Esc",
  "Stop all connected robots while none is armed; Space plays instead where there is a player",
]);

// A menu that Esc closes even though the focus is on the button that opened it.
const MENU = ':popover-open:not([popover="manual"])';

/**
 * Make Space and Esc stop the robots.
 *
 * While a robot is armed they always stop and do nothing else, even while typing or with a button
 * focused. Otherwise they keep their usual meaning in fields, buttons and dialogs, Space plays on
 * pages with a player (`playOnSpace`), and they stop everywhere else if a robot is connected.
 *
 * @param {import("./driver.js").Driver} driver
 */
export function listenForStop(driver) {
  let taken = "";
  window.addEventListener(
    "keydown",
    (event) => {
      if (!isStop(event) || !driver.anyArmed) {
        // The release of an earlier press may not have arrived, as from the frame of the 3D scene.
        if (event.code === taken && !event.repeat) taken = "";
        return;
      }
      event.preventDefault();
      event.stopImmediatePropagation();
      taken = event.code;
      if (!event.repeat) void driver.stop().catch(() => {});
    },
    { capture: true },
  );
  // A button is activated when Space is released.
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
  // After all other handlers of these keys.
  window.addEventListener("keydown", (event) => {
    if (!isStop(event) || event.defaultPrevented || event.repeat || !driver.anyConnected) return;
    const target = /** @type {HTMLElement | null} */ (event.target);
    if (target?.closest?.("dialog, [popover]") || (target && target.tagName && writesText(target)))
      return;
    if (event.code === "Space" && usesSpace(target)) return;
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
