import assert from "node:assert/strict";
import { test } from "node:test";

import * as words from "../../../static/app/driving/robot-words.js";
import { sonarInWords } from "../../../static/app/driving/sonar-ring.js";
import { goal, report, robot, robots as facts } from "../made.mjs";

/** @import { RobotsMessage } from "../../../static/app/contract" */

test("a stop comes before every other reason for which a robot stands", () => {
  const faulty = robot({ why: "it is far", report: report({ fault: "a wheel stalls" }) });
  const because = (/** @type {RobotsMessage} */ known) =>
    words.standstillReason("observer", faulty, known, true, "operator 2");
  assert.match(
    because(facts({ stopped: { by: "Ann", since: 0 } })),
    /^Stopped by Ann\. Reset the stop/,
  );
  assert.match(
    because(facts({ stopped: { by: "operator 2", since: 0 } })),
    /^Stopped by you\. Reset the stop/,
  );
  assert.equal(because(facts()), "A wheel stalls.");
});

test("a robot that is not reached says why", () => {
  const waiting = robot({ state: "waiting", report: report({ trouble: "no answer" }) });
  assert.equal(words.standstillReason("observer", waiting, facts(), true, ""), "No answer.");
  const connecting = robot({ state: "connecting" });
  assert.equal(
    words.standstillReason("observer", connecting, facts(), true, ""),
    "Connecting to the robot.",
  );
});

test("who is armed waits for whoever drives it", () => {
  const armed = robot({ state: "armed" });
  assert.match(
    words.standstillReason("observer", armed, facts(), true, ""),
    /^Armed\. Hold the pad/,
  );
  assert.match(
    words.standstillReason("observer", armed, facts(), false, ""),
    /another operator has control/i,
  );
});

test("an observer on its way to a goal says so", () => {
  const because = (/** @type {"observer" | "obstacle"} */ role, /** @type {any} */ state) =>
    words.standstillReason(
      role,
      robot({ state: "armed" }),
      facts({ goal: goal({ state }) }),
      true,
      "",
    );
  assert.equal(because("observer", "driving"), "Driving to a goal autonomously.");
  assert.match(because("obstacle", "driving"), /^Armed\./);
  assert.match(because("observer", "reached"), /^Armed\./);
});

test("who is concerned by an incident is named", () => {
  const incident = { at: "?", role: null, sentence: "it ended", speed_mps: null, stops: {} };
  const told = (/** @type {string} */ kind) => words.incidentInWords({ ...incident, kind });
  assert.equal(told("goal"), "? Observer: It ended.");
  assert.equal(told("programme"), "? Both robots: It ended.");
  const stop = { zero_ms: 0, stood_ms: 717, distance_m: 0.06, speed_mps: 0.3, separation_m: null };
  assert.equal(
    words.incidentInWords({
      ...incident,
      kind: "stop",
      sentence: "all robots were stopped by 127.0.0.1",
      stops: { observer: stop },
    }),
    "?: All robots were stopped by 127.0.0.1; stop command sent after 0 ms; " +
      "standstill after 717 ms and 0.06 m.",
  );
});

test("where there is no robot the reason is told", () => {
  const because = (/** @type {RobotsMessage | null} */ known) =>
    words.standstillReason("obstacle", null, known, false, "");
  assert.equal(because(null), "Waiting for robot status.");
  const ports = { observer: null, obstacle: { port: "/dev/ttyUSB0", model: null } };
  assert.match(
    because(facts({ ports, world: "simulated" })),
    /only while live cameras are the current source/,
  );
  assert.match(because(facts({ world: null })), /^The current source has no robots/);
  assert.match(because(facts()), /enter its port/i);
  const trouble = { observer: null, obstacle: "the port is busy" };
  assert.equal(because(facts({ ports, trouble })), "The port is busy.");
});

test("who drives, and whether they are there", () => {
  assert.equal(words.driverInWords(robot({ operator: "Ann" }), true), "You have control");
  assert.equal(
    words.driverInWords(robot({ operator: "Ann" }), false),
    "Ann has control, but is not present",
  );
  assert.equal(words.driverInWords(robot(), false), "Nobody has control");
  assert.equal(words.driverInWords(null, false), "");
});

test("a battery tells what is out of the ordinary", () => {
  const battery = (/** @type {Parameters<typeof report>[0]} */ changes) =>
    words.batteryInWords(report(changes));
  assert.equal(battery({}), "–");
  assert.equal(battery({ battery_v: 12.34, battery: "good", charging: "no" }), "12.3 V");
  assert.equal(battery({ battery_v: 11, battery: "low", charging: "bulk" }), "11.0 V, low, bulk");
});

test("figures say what is not known, which wheel stalls and which bumper is pressed", () => {
  const told = (/** @type {Parameters<typeof report>[0]} */ changes) =>
    Object.fromEntries(
      words.figuresOf(robot({ report: report(changes) })).map(([term, text]) => [term, text]),
    );
  const unknown = told({});
  assert.deepEqual(
    ["Wheel encoders", "Wheels", "Hardware stop", "Bumpers"].map((term) => unknown[term]),
    ["–", "–", "–", "none fitted"],
  );
  assert.equal(told({ stalled: [false, true] })["Wheels"], "right stalled");
  const watchdogs = [null, 0, 2].map((watchdog_s) => told({ watchdog_s })["Robot watchdog"]);
  assert.deepEqual(watchdogs, ["–", "off", "2.0 s"]);
  assert.equal(
    told({ front_bumpers: [true, false, true], rear_bumpers: [false, true] })["Bumpers"],
    "front 1, 3; rear 2",
  );
  assert.equal(
    told({ odometry: { x: 1, y: -0.5, yaw: Math.PI / 2 } })["Wheel odometry"],
    "1.00, −0.50 m, 90°",
  );
});

test("a stop is told with what was measured of it", () => {
  const stop = { zero_ms: 220, stood_ms: 610, distance_m: 0.123, speed_mps: 0.3 };
  assert.equal(
    words.stopInWords({ ...stop, separation_m: 0.4 }),
    "stop command sent after 220 ms; standstill after 610 ms and 0.12 m; 0.40 m clearance",
  );
  assert.equal(
    words.stopInWords({ ...stop, zero_ms: null, stood_ms: null, separation_m: null }),
    "no stop command sent; standstill not observed",
  );
});

test("turns have a side, times have minutes", () => {
  assert.equal(words.turnInWords(0.2), "11 °/s to the left");
  assert.equal(words.turnInWords(-0.2), "11 °/s to the right");
  assert.equal(words.turnInWords(0.001), "straight");
  assert.deepEqual([65, 59.6, -3].map(words.clock), ["1:05", "1:00", "0:00"]);
});

test("a robot that stands still does not also go straight", () => {
  const at = (/** @type {number} */ speed_mps, /** @type {number} */ turn_rate_radps) =>
    words.velocityInWords({ speed_mps, turn_rate_radps });
  assert.equal(at(0, 0), "standstill");
  assert.equal(at(0.2, 0), "0.20 m/s, straight");
  assert.equal(at(0, 0.2), "0.00 m/s, 11 °/s to the left");
});

test("what must be done first is said once for both robots", () => {
  assert.equal(words.firstSteps([]), "");
  assert.equal(
    words.firstSteps([
      ["arm", "observer"],
      ["arm", "obstacle"],
    ]),
    "Arm the observer and the obstacle first.",
  );
  assert.equal(
    words.firstSteps([
      ["arm", "observer"],
      ["connect", "obstacle"],
    ]),
    "Arm the observer and connect the obstacle first.",
  );
});

test("sonars tell the nearest echo and how old the oldest word is", () => {
  const reading = { index: 0, x: 0, y: 0, heading: 0 };
  const sonars = [
    { ...reading, range_m: 1.5, received: 9.5 },
    { ...reading, range_m: null, received: 9 },
  ];
  assert.equal(
    sonarInWords(robot({ report: report({ sonars }) })),
    "Sonar: nearest 1.50\u00a0m, up to 1.0\u00a0s old",
  );
  assert.equal(sonarInWords(null), "No sonar");
});

test("a held robot that is sent zero says why, one that is only slowed does not", () => {
  const reply = (/** @type {number} */ speed_mps, /** @type {string | null} */ limited_by) =>
    words.heldBackReason({
      type: "sent",
      role: "observer",
      sequence: 1,
      age_ms: 20,
      speed_mps,
      turn_rate_radps: 0,
      limited_by,
    });
  assert.equal(reply(0, "obstacle 1 is close"), "Obstacle 1 is close.");
  assert.equal(reply(0.1, "obstacle 1 is close"), "");
  assert.equal(reply(0, null), "");
  assert.equal(words.heldBackReason(null), "");
});
