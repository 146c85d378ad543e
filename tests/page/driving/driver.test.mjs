import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { report, robot, robots } from "../made.mjs";

/** @import { Hub } from "../../../static/app/shell/hub.js" */

const AHEAD = { forward: 1, left: 0 };
const TICK_MS = 100;
const LIMITS = {
  speed_mps: 0.4,
  turn_rate_radps: 1,
  acceleration_mps2: 0.3,
  turn_acceleration_radps2: 1,
};

/** Milliseconds of the page's clock. */
let now = 0;
mock.method(performance, "now", () => now);
mock.timers.enable({ apis: ["setInterval", "setTimeout"] });
Object.assign(globalThis, {
  window: new EventTarget(),
  document: Object.assign(new EventTarget(), {
    hidden: false,
    documentElement: { dataset: {} },
  }),
  location: { protocol: "http:", host: "here" },
  localStorage: { getItem: () => null, setItem: () => {} },
});
const { Driver } = await import("../../../static/app/driving/driver.js");

/** A page that controls an armed robot, and what its driver has sent since the last look. */
function driving() {
  const hub = Object.assign(new Emitter(), {
    connection: "open",
    heardAt: now,
    robots: robots({
      robots: {
        observer: robot({ state: "armed", report: report({ limits: LIMITS }) }),
        obstacle: null,
      },
    }),
  });
  const driver = new Driver(/** @type {Hub} */ (/** @type {unknown} */ (hub)));
  /** @type {string[]} */
  let sent = [];
  driver.link.connection = "open";
  driver.link.leases.set("observer", "lease");
  driver.link.present = () => sent.push("present");
  driver.link.drive = (_, { speed_mps }) => sent.push(speed_mps ? "drive" : "zero");
  return {
    hub,
    driver,
    /** Let time pass. @param {number} ms @param {boolean} [heard] while the server sends something */
    pass(ms, heard = false) {
      sent = [];
      for (const end = now + ms; now < end;) {
        now += TICK_MS;
        if (heard) hub.heardAt = now;
        mock.timers.tick(TICK_MS);
      }
      return sent;
    },
    /** @param {string} connection */
    connect(connection) {
      sent = [];
      hub.connection = connection;
      hub.emit("connection");
      return sent;
    },
  };
}

test("the operator is present while the server is heard, and for a second after it", () => {
  const { pass, connect } = driving();
  assert.deepEqual(pass(300, true), ["present", "present", "present"]);
  connect("closed");
  assert.deepEqual(new Set(pass(1000)), new Set(["present"]));
  assert.deepEqual(pass(3000), []);
  // Opened again, but nothing was received yet.
  connect("open");
  assert.deepEqual(pass(500), []);
  assert.deepEqual(pass(200, true), ["present", "present"]);
});

test("a held control ends with the connection, until it was let go", () => {
  const { driver, pass, connect } = driving();
  pass(100, true);
  driver.hold.set("keys", AHEAD);
  assert.deepEqual(pass(200, true), ["drive", "drive"]);
  assert.deepEqual(connect("connecting"), ["zero"]);
  assert.equal(driver.note, "Connection to the server lost: let go and press again.");
  connect("open");
  assert.deepEqual(pass(200, true), ["present", "present"]);
  driver.hold.release("keys");
  driver.hold.set("keys", AHEAD);
  assert.deepEqual(pass(200, true), ["drive", "drive"]);
});

test("a held control ends when an open connection falls silent", () => {
  const { driver, pass } = driving();
  pass(100, true);
  driver.hold.set("keys", AHEAD);
  assert.equal(pass(1000).filter((each) => each !== "drive").length, 0);
  assert.deepEqual(pass(500), ["zero"]);
  assert.equal(driver.note, "The server is not responding: let go and press again.");
  assert.deepEqual(new Set(pass(300, true)), new Set(["present"]));
});

test("a held control ends when the robot is lost, and says why in a sentence", () => {
  const { driver, hub, pass } = driving();
  pass(100, true);
  driver.hold.set("keys", AHEAD);
  const lost = robot({ state: "waiting", report: report({ trouble: "no answer" }) });
  hub.robots = robots({ robots: { observer: lost, obstacle: null } });
  hub.emit("robots");
  assert.deepEqual([driver.hold.isActive, driver.note], [false, "No answer."]);
});

test("nobody is asked to arm a robot through a read-only link", () => {
  const { driver } = driving();
  assert.equal(driver.blockedReason, "");
  document.documentElement.dataset.access = "read_only";
  assert.equal(driver.blockedReason, "This link is read-only: it cannot drive robots.");
  delete document.documentElement.dataset.access;
});
