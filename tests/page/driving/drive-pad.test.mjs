import assert from "node:assert/strict";
import { test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { Hold } from "../../../static/app/driving/hold.js";
import { settled } from "../fake-page.mjs";
import { robot, robots } from "../made.mjs";

const { DrivePad } = await import("../../../static/app/driving/drive-pad.js");

const NEAR = "an obstacle is 0.3 m ahead";

/** A pad held by its operator, whose robot stands still because of the guard. */
async function held() {
  const observer = robot({ state: "armed" });
  const link = Object.assign(new Emitter(), {
    connection: "open",
    quality: null,
    operator: "Ann",
    sent: new Map([["observer", { speed_mps: 0, turn_rate_radps: 0, limited_by: NEAR }]]),
  });
  const driver = Object.assign(new Emitter(), {
    link,
    hold: new Hold(),
    role: "observer",
    share: 0.5,
    note: "",
    topSpeed: { speed_mps: 0.2, turn_rate_radps: 0.5 },
    blockedReason: "",
    robot: () => observer,
  });
  const hub = Object.assign(new Emitter(), { driver, robots: robots(), connection: "open" });
  driver.hold.set("keys", { forward: 1, left: 0 });
  const pad = /** @type {any} */ (new DrivePad());
  pad.attach(hub);
  await settled();
  return { driver, words: () => String(pad.textContent) };
}

test("a limit that keeps the robot standing is shown once", async () => {
  const { words } = await held();
  assert.match(words(), /An obstacle is 0\.3 m ahead\./);
  assert.ok(!words().includes("Limited:"));
});

test("the limit is shown beside a more urgent reason", async () => {
  const { driver, words } = await held();
  driver.blockedReason = "A programme is running: stop it first.";
  driver.emit("change");
  assert.match(words(), /A programme is running/);
  assert.match(words(), new RegExp(`Limited: ${NEAR}`));
});
