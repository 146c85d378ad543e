/** Driving with W, A, S, D and the arrow keys. */

import { declareKeys, writesText } from "../elements/keys.js";

declareKeys("Driving", ["W A S D ↑ ← ↓ →", "Drive while held"]);

/** Keys by position, whatever their letter. @type {Record<string, [number, number]>} */
const DIRECTIONS = {
  KeyW: [1, 0],
  ArrowUp: [1, 0],
  KeyS: [-1, 0],
  ArrowDown: [-1, 0],
  KeyA: [0, 1],
  ArrowLeft: [0, 1],
  KeyD: [0, -1],
  ArrowRight: [0, -1],
};
// Elements that use the arrow keys themselves.
const OWN_ARROWS =
  'input, select, [role="tab"], [role="listbox"], [role="radio"], .pixel-pick, .uplot, dialog';

/**
 * Follow the window's keys for the lifetime of the page.
 *
 * @param {import("./driver.js").Driver} driver
 */
export function followKeys(driver) {
  const { hold } = driver;
  /** @type {Set<string>} */
  const down = new Set();

  const show = () => {
    if (down.size === 0) return hold.release("keys");
    let [forward, left] = [0, 0];
    for (const code of down) {
      const [ahead, turn] = DIRECTIONS[code] ?? [0, 0];
      forward += ahead;
      left += turn;
    }
    hold.set("keys", { forward: clamp(forward), left: clamp(left) });
  };
  const releaseKeys = () => {
    down.clear();
    show();
  };

  window.addEventListener("keydown", (event) => {
    // With a modifier the key is a browser shortcut, and some browsers never report its release.
    if (event.ctrlKey || event.metaKey || event.altKey) return releaseKeys();
    if (!(event.code in DIRECTIONS) || event.defaultPrevented) return;
    const target = event.target instanceof HTMLElement ? event.target : document.body;
    if (writesText(target)) return;
    if (
      target.closest(OWN_ARROWS) &&
      (event.code.startsWith("Arrow") || target.closest("select, dialog"))
    )
      return;
    const drives =
      down.size > 0 || driver.blockedReason === "" || target.closest("observer-drive-pad") !== null;
    if (!drives) return;
    // Keep the page from scrolling.
    event.preventDefault();
    if (event.repeat) return;
    down.add(event.code);
    show();
  });
  window.addEventListener("keyup", (event) => {
    if (down.delete(event.code)) show();
  });
  window.addEventListener("focusin", (event) => {
    if (event.target instanceof HTMLElement && writesText(event.target)) releaseKeys();
  });
  hold.addEventListener("cleared", () => down.clear());
}

/** @param {number} value */
function clamp(value) {
  return Math.max(-1, Math.min(1, value));
}
