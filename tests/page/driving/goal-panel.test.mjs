import assert from "node:assert/strict";
import { test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { FloorPick } from "../../../static/app/shell/floor-pick.js";
import { buttonOf, partOf, serve, settled } from "../fake-page.mjs";
import { goal, robot, robots } from "../made.mjs";

await import("../../../static/app/driving/goal-panel.js");

/** A panel of an armed observer, the hub, and the goals sent. */
async function made() {
  /** @type {any[]} */
  const sent = [];
  serve((method, path, body) => {
    if (method === "POST" && path === "/goal") sent.push(body);
    if (path === "/parameters") return { values: {} };
    return method === "GET" ? [] : {};
  });
  Object.assign(document, { querySelector: () => document.body });
  const observer = robot({ state: "armed", operator: "Ann" });
  const driver = Object.assign(new Emitter(), {
    link: { leases: new Map([["observer", "lease"]]) },
    robot: () => observer,
  });
  const hub = Object.assign(new Emitter(), {
    driver,
    floorPick: new FloorPick(),
    robots: robots({ robots: { observer, obstacle: null } }),
    connection: "open",
    robotsOutdated: false,
  });
  hub.floorPick.possible = true;
  const panel = partOf("observer-goal");
  panel.attach(hub);
  await settled();
  return { hub, panel, sent };
}

test("the scene says that a goal was sent only while the robot may drive there", async () => {
  const { hub, panel, sent } = await made();
  buttonOf(panel, "Pick a goal").fire("click");
  hub.floorPick.answer({ ahead: 1, left: 0.5 });
  await settled();
  assert.deepEqual([sent[0]?.ahead_m, sent[0]?.left_m], [1, 0.5]);
  const words = "Goal sent: 1.00 m ahead, 0.50 m to the left.";
  // The newest message is of before the goal.
  hub.emit("robots");
  assert.equal(hub.floorPick.words, words);
  hub.robots.goal = goal({ state: "driving" });
  hub.emit("robots");
  assert.equal(hub.floorPick.words, words);
  hub.robots.goal = goal({ state: "ended", sentence: "The goal was cancelled." });
  hub.emit("robots");
  assert.equal(hub.floorPick.words, "");
});

test("no goal is sent to a server that has become silent since the request for a click", async () => {
  const { hub, panel, sent } = await made();
  buttonOf(panel, "Pick a goal").fire("click");
  hub.robotsOutdated = true;
  hub.floorPick.answer({ ahead: 1, left: 0.5 });
  await settled();
  assert.deepEqual(sent, []);
  assert.match(String(panel.textContent), /Not sent: the server is not responding\./);
});
