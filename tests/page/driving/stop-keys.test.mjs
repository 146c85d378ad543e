import assert from "node:assert/strict";
import { test } from "node:test";

/** @import { Driver } from "../../../static/app/driving/driver.js" */

const window = new EventTarget();
Object.assign(globalThis, {
  window,
  document: { querySelector: () => null },
  HTMLInputElement: class {},
});
const { listenForStop } = await import("../../../static/app/driving/stop-keys.js");

const driver = {
  anyArmed: false,
  anyConnected: true,
  stops: 0,
  stop: async () => void (driver.stops += 1),
};
listenForStop(/** @type {Driver} */ (/** @type {unknown} */ (driver)));

/**
 * Press or release Space. While nothing is armed, a part of the page uses it, as a button does.
 *
 * @param {"keydown" | "keyup"} type
 */
function space(type, repeat = false) {
  const event = Object.assign(new Event(type, { cancelable: true }), {
    key: " ",
    code: "Space",
    repeat,
  });
  Object.defineProperty(event, "target", { value: { tagName: "BUTTON", closest: () => true } });
  window.dispatchEvent(event);
  return event;
}

test("the release of the Space that stopped does nothing else", () => {
  driver.anyArmed = true;
  assert.ok(space("keydown").defaultPrevented);
  driver.anyArmed = false;
  // Held down while the robot is already stopped.
  space("keydown", true);
  assert.ok(space("keyup").defaultPrevented);
  assert.equal(driver.stops, 1);
});

test("a Space pressed after a stop without a release is not swallowed", () => {
  driver.anyArmed = true;
  space("keydown");
  driver.anyArmed = false;
  assert.ok(!space("keydown").defaultPrevented);
  assert.ok(!space("keyup").defaultPrevented);
});
