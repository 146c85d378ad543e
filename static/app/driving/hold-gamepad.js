/** Driving by a gamepad: a shoulder button is held, the left stick steers. */

import { beyondStill } from "./hold.js";

// Of the standard layout: left and right shoulder, and the one on the right of the four.
const SHOULDERS = [4, 5];
const STOPS = 1;
const EVERY_MS = 50;

/**
 * Follow the first gamepad as long as the page lives.
 *
 * @param {import("./driver.js").Driver} driver
 */
export function followGamepad(driver) {
  const { hold } = driver;
  // Held while nobody looked (it was connected so, or the page was left): let it go first.
  let seenReleased = false;
  let stopped = false;
  let timer = 0;

  const look = () => {
    const pad = connected();
    if (!pad) {
      clearInterval(timer);
      timer = 0;
      seenReleased = false;
      return hold.release("gamepad");
    }
    const stops = pad.buttons[STOPS]?.pressed ?? false;
    if (stops && !stopped) void driver.stop().catch(() => {});
    stopped = stops;
    const held = document.hasFocus() && SHOULDERS.some((button) => pad.buttons[button]?.pressed);
    if (!held) {
      seenReleased = true;
      hold.release("gamepad");
    } else if (seenReleased) {
      hold.set("gamepad", {
        forward: -beyondStill(pad.axes[1] ?? 0),
        left: -beyondStill(pad.axes[0] ?? 0),
      });
    }
  };

  const begin = () => {
    timer ||= setInterval(look, EVERY_MS);
  };
  window.addEventListener("gamepadconnected", begin);
  window.addEventListener("gamepaddisconnected", look);
  hold.addEventListener("forgotten", () => {
    seenReleased = false;
  });
  if (connected()) begin();
}

/** @returns {Gamepad | null} */
export function connected() {
  return navigator.getGamepads?.().find((pad) => pad?.connected) ?? null;
}
