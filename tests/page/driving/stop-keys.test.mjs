import assert from "node:assert/strict";
import { test } from "node:test";

/** @import { Driver } from "../../../static/app/driving/driver.js" */

const window = new EventTarget();
Object.assign(globalThis, {
  window,
  document: Object.assign(new EventTarget(), { querySelector: () => null }),
  HTMLInputElement: class {},
});
const { listenForStop } = await import("../../../static/app/driving/stop-keys.js");

const { playOnSpace } = await import("../../../static/app/elements/keys.js");

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

/** @import { Part } from "../../../static/app/elements/part.js" */

test("where there is a player, Space plays unless a robot is armed", () => {
  const player = {
    listen: (/** @type {string} */ type, /** @type {EventListener} */ heard) =>
      document.addEventListener(type, heard),
  };
  const page = { shown: true, played: 0 };
  playOnSpace(
    /** @type {Part} */ (/** @type {unknown} */ (player)),
    () => page.shown,
    () => void (page.played += 1),
  );
  driver.stops = 0;
  const press = (/** @type {unknown} */ target, repeat = false) => {
    const key = { key: " ", code: "Space", repeat };
    const event = Object.assign(new Event("keydown", { cancelable: true }), key);
    Object.defineProperty(event, "target", { value: target });
    // The window hears it first while a robot is armed, and last otherwise.
    if (driver.anyArmed) window.dispatchEvent(event);
    document.dispatchEvent(event);
    if (!driver.anyArmed) window.dispatchEvent(event);
  };
  const body = { tagName: "BODY", closest: () => null };
  const button = { tagName: "BUTTON", closest: () => true, matches: () => false };
  const slider = { tagName: "INPUT", closest: () => true, matches: () => true };
  driver.anyArmed = false;
  for (const target of [body, slider, button]) press(target);
  press(body, true);
  assert.deepEqual([page.played, driver.stops], [2, 0]);
  for (const target of [body, slider, button]) {
    driver.anyArmed = true;
    press(target);
  }
  assert.deepEqual([page.played, driver.stops], [2, 3]);
  driver.anyArmed = page.shown = false;
  press(body);
  assert.deepEqual([page.played, driver.stops], [2, 4]);
});
