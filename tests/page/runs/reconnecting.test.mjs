import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { serve, settled } from "../fake-page.mjs";
import { run } from "../made.mjs";

mock.timers.enable({ apis: ["setTimeout"] });
Object.assign(globalThis, { createImageBitmap: async () => ({ close() {}, width: 4, height: 2 }) });
const { MethodsView } = await import("../../../static/app/runs/methods-view.js");
const { RunPlayer } = await import("../../../static/app/runs/run-player.js");
const { RunView } = await import("../../../static/app/runs/run-view.js");

const GONE = /server is gone/;
const FRAMES = { count: 0, every: 1, first: 0, width: 4, height: 2, frames: [], maps: [] };

/**
 * Attach a part to a page whose server can be gone.
 *
 * @param {any} part
 * @param {(path: string) => unknown} answer while it is not
 */
function served(part, answer) {
  const server = { gone: false, asked: /** @type {string[]} */ ([]) };
  serve((_, path) => {
    server.asked.push(path);
    return server.gone ? new Error("the server is gone") : answer(path);
  });
  const hub = Object.assign(new Emitter(), { status: { source: null, reruns: [] } });
  part.attach(hub);
  const reconnect = async () => {
    server.gone = false;
    server.asked = [];
    hub.emit("reconnected");
    await settled();
    await settled();
  };
  return { server, reconnect };
}

test("a run's page clears its error and keeps reading a running run", async () => {
  const running = run({ state: "running" });
  const view = /** @type {any} */ (new RunView());
  const { server } = served(view, (path) => {
    if (path === "/runs/r1") return running;
    return path === "/runs/r1/chart" ? { run: running, alignment: null, curves: [] } : [];
  });
  // No plots: they need a real page.
  for (const part of view.querySelectorAll("observer-part")) part.isConnected = false;
  view.show("r1");
  await settled();
  await settled();
  server.gone = true;
  mock.timers.tick(5000);
  await settled();
  assert.match(view.textContent, GONE);
  server.gone = false;
  mock.timers.tick(5000);
  await settled();
  await settled();
  assert.ok(!GONE.test(view.textContent));
});

test("the comparison's page is read again if it could not be read", async () => {
  const view = /** @type {any} */ (new MethodsView());
  const { server, reconnect } = served(view, (path) => {
    if (path === "/comparison") return { going: null, runs: null, trouble: null };
    if (path.startsWith("/history")) return { runs: [] };
    return path.endsWith("/frames") ? FRAMES : [];
  });
  server.gone = true;
  view.show(["r1", "r2"]);
  await settled();
  await settled();
  await reconnect();
  assert.ok(server.asked.includes("/sources"));
  assert.ok(server.asked.includes("/runs/r1/frames"));
});

test("the player loads frames and images again if it could not load them", async () => {
  for (const lost of ["frames", "images"]) {
    const player = /** @type {any} */ (new RunPlayer());
    const { server, reconnect } = served(player, (path) =>
      lost === "images" && path.endsWith(".jpg") ? new Error("the server is gone") : FRAMES,
    );
    server.gone = lost === "frames";
    player.show(run());
    await settled();
    await settled();
    await reconnect();
    assert.ok(server.asked.includes("/runs/r1/frames?most=1000"), lost);
    assert.ok(server.asked.includes("/runs/r1/frames/0.jpg"), lost);
  }
});

test("the player does not load again what it has", async () => {
  const player = /** @type {any} */ (new RunPlayer());
  const { server, reconnect } = served(player, () => FRAMES);
  player.show(run());
  await settled();
  await reconnect();
  assert.deepEqual(server.asked, []);
});
