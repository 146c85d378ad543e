import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { FakeElement, buttonOf, serve, settled } from "../fake-page.mjs";

/** @import { Hub } from "../../../static/app/shell/hub.js" */

mock.timers.enable({ apis: ["setInterval"] });
const { RigPanel } = await import("../../../static/app/calibration/rig-panel.js");

const POLL_MS = 2000;
const number = (/** @type {number} */ value) => ({ value, sigma: 0.01 });

/** A panel, the heights that the server estimates, and the requests it gets while driving. */
async function shown() {
  const server = {
    driven_m: 0.5,
    floor_m: 0.6,
    asked: /** @type {string[]} */ ([]),
    saved: /** @type {unknown[]} */ ([]),
  };
  serve((method, path, body) => {
    if (path === "/rig" && method === "PUT") {
      server.saved.push(body.mount);
      const mount = Object.entries(body.mount).filter(([, number]) => number !== null);
      return { mount: Object.fromEntries(mount), for_simulated: false, in_use: null };
    }
    if (path === "/rig") return { mount: {}, for_simulated: false };
    if (path === "/rig/floor")
      return {
        height_m: number(server.floor_m),
        tilt_deg: number(10),
        roll_deg: number(0),
        sentence: "",
      };
    server.asked.push(method);
    return { values: { height_m: number(server.driven_m) }, sentence: "" };
  });
  const panel = new RigPanel();
  const status = { source: { spec: "simulated:people" } };
  const hub = Object.assign(new EventTarget(), { status });
  panel.attach(/** @type {Hub} */ (/** @type {unknown} */ (hub)));
  await settled();
  const height = [...panel.querySelectorAll("input")].find(({ id }) => id === "rig-height_m");
  if (!height) throw new Error("no field");
  return { server, panel, height };
}

/** @param {unknown} panel @param {string} name */
async function press(panel, name) {
  buttonOf(panel, name).fire("click");
  await settled();
}

async function poll() {
  mock.timers.tick(POLL_MS);
  await settled();
}

test("estimating while driving does not replace what is typed meanwhile", async () => {
  const { server, panel, height } = await shown();
  await press(panel, "Estimate while driving");
  assert.equal(height.value, "0.5");
  server.driven_m = 0.51;
  await poll();
  assert.equal(height.value, "0.51");
  height.value = "0.8";
  height.dispatchEvent(new Event("input"));
  await poll();
  assert.equal(height.value, "0.8");
  height.value = "";
  Object.assign(document, { activeElement: height });
  await poll();
  assert.equal(height.value, "");
  Object.assign(document, { activeElement: null });
  await press(panel, "Stop estimating");
});

test("nor what is estimated from the floor meanwhile", async () => {
  const { panel, height } = await shown();
  await press(panel, "Estimate while driving");
  await press(panel, "Estimate from the floor");
  await poll();
  assert.equal(height.value, "0.6");
  await press(panel, "Stop estimating");
});

test("presses before the answer to the first one change nothing", async () => {
  const { server, panel } = await shown();
  for (let times = 0; times < 3; times += 1)
    buttonOf(panel, "Estimate while driving").fire("click");
  await settled();
  await poll();
  assert.deepEqual(server.asked, ["POST", "GET"]);
  await press(panel, "Stop estimating");
  await poll();
  assert.deepEqual(server.asked, ["POST", "GET", "DELETE"]);
});

/** What is wrong with the fields, beside them. @param {unknown} panel */
function errorOf(panel) {
  const paragraphs = /** @type {HTMLElement} */ (panel).querySelectorAll("p");
  return [...paragraphs].find(({ id }) => id === "rig-error")?.textContent;
}

/** @param {unknown} panel */
async function save(panel) {
  /** @type {any} */ (panel).querySelector("form").fire("submit");
  await settled();
}

test("an empty mount is refused beside the fields, and is not sent", async () => {
  const { server, panel } = await shown();
  await save(panel);
  assert.equal(errorOf(panel), "Enter the height and the tilt, or estimate them.");
  assert.deepEqual(server.saved, []);
});

test("what was wrong with a field is gone once an estimate fills it", async () => {
  const { panel, height } = await shown();
  height.value = "high";
  await save(panel);
  assert.match(String(errorOf(panel)), /^Height must be a number/);
  await press(panel, "Estimate from the floor");
  assert.equal(errorOf(panel), "");
  assert.equal(height.getAttribute("aria-invalid"), null);
});

test("a mount for real cameras does not claim to be in use on a simulated source", async () => {
  const { panel, height } = await shown();
  const notices = new FakeElement();
  mock.method(document, "querySelector", () => notices);
  height.value = "0.8";
  await save(panel);
  assert.equal(
    notices.textContent,
    "Saved for real cameras. This simulated source keeps its own mount.",
  );
});
