/** Driving with a gamepad: hold a shoulder button and steer with the left stick. */

import { applyDeadZone } from "./hold.js";

// Standard layout: left and right shoulder, and the right one of the four face buttons.
const SHOULDER_BUTTONS = [4, 5];
const STOPS = 1;
const POLL_EVERY_MS = 50;

/**
 * Follow the first gamepad for the lifetime of the page.
 *
 * @param {import("./driver.js").Driver} driver
 */
export function followGamepad(driver) {
  const { hold } = driver;
  // If it was already held (when it was connected or the page regained focus), require a release.
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
    const held =
      document.hasFocus() && SHOULDER_BUTTONS.some((button) => pad.buttons[button]?.pressed);
    if (!held) {
      seenReleased = true;
      hold.release("gamepad");
    } else if (seenReleased) {
      hold.set("gamepad", {
        forward: -applyDeadZone(pad.axes[1] ?? 0),
        left: -applyDeadZone(pad.axes[0] ?? 0),
      });
    }
  };

  const begin = () => {
    timer ||= setInterval(look, POLL_EVERY_MS);
  };
  window.addEventListener("gamepadconnected", begin);
  window.addEventListener("gamepaddisconnected", look);
  hold.addEventListener("cleared", () => {
    seenReleased = false;
  });
  if (connected()) begin();
}

/** @returns {Gamepad | null} */
export function connected() {
  return navigator.getGamepads?.().find((pad) => pad?.connected) ?? null;
}
