import assert from "node:assert/strict";
import { test } from "node:test";

import { ParameterStore } from "../../../static/app/parameters/parameter-store.js";

/** @import { ParameterValue } from "../../../static/app/parameters/parameter-store.js" */

/** @typedef {Record<string, ParameterValue>} Values */

/** A fake server with two parameters below 10, and the changes requested, in order. */
function served() {
  /** @type {Values} */
  const values = { "a.x": 1, "a.y": 2 };
  const presets = [
    { name: "default", help: "", values: { "a.y": 5 }, built_in: true },
    { name: "paper", help: "", values: { "a.x": 8 }, built_in: true },
  ];
  let basedOn = "default";
  const schema = [
    { name: "a.x", default: 1, title: "Width", group: "a", help: "", group_help: "" },
    { name: "a.y", default: 2, title: "Height", group: "a", help: "Above a.x.", group_help: "" },
  ];
  /** @type {Values[]} */
  const asked = [];
  let revision = 1;
  const answers = () => ({
    "/api/parameters/schema": schema,
    "/api/presets": presets,
    "/api/parameters": {
      revision,
      driving_revision: 0,
      values: { ...values },
      preset: null,
      based_on: basedOn,
      frame: null,
    },
  });
  /** @type {(url: string, options: {method: string, body?: string}) => Promise<Response>} */
  const fetched = async (url, { method, body }) => {
    const { pathname, searchParams } = new URL(url, "http://server");
    if (method === "PATCH") {
      /** @type {Values} */
      const changes = JSON.parse(body ?? "{}");
      asked.push(changes);
      const bad = Object.entries(changes).filter(([, value]) => Number(value) >= 10);
      const detail = bad.map(([name]) => ({ loc: ["body", name], msg: "must be below 10" }));
      if (bad.length) return Response.json({ detail }, { status: 422 });
      Object.assign(values, changes);
      basedOn = searchParams.get("based_on") ?? basedOn;
      revision += 1;
    }
    return Response.json(answers()[/** @type {"/api/presets"} */ (pathname)]);
  };
  globalThis.fetch = /** @type {typeof fetch} */ (/** @type {unknown} */ (fetched));
  return asked;
}

async function loaded() {
  const asked = served();
  const store = new ParameterStore();
  await store.load();
  return { asked, store };
}

test("what is changed while a request is under way goes with the next one", async () => {
  const { asked, store } = await loaded();
  const taken = await Promise.all([
    store.change({ "a.x": 3 }),
    store.change({ "a.x": 4 }),
    store.change({ "a.y": 7 }),
  ]);
  assert.deepEqual(taken, [true, true, true]);
  assert.deepEqual(asked, [{ "a.x": 3 }, { "a.x": 4, "a.y": 7 }]);
  assert.deepEqual(store.state.values, { "a.x": 4, "a.y": 7 });
});

test("a change is undone and done again", async () => {
  const { store } = await loaded();
  await store.changeUndoably({ "a.x": 3 });
  assert.deepEqual([store.canUndo, store.canRedo], [true, false]);
  await store.undo();
  assert.equal(store.state.values["a.x"], 1);
  assert.deepEqual([store.canUndo, store.canRedo], [false, true]);
  await store.redo();
  assert.equal(store.state.values["a.x"], 3);
  await store.changeUndoably({ "a.y": 3 });
  assert.equal(store.canRedo, false);
});

test("undo waits for the change that is still on its way", async () => {
  const { store } = await loaded();
  void store.changeUndoably({ "a.x": 3 });
  await store.undo();
  assert.equal(store.state.values["a.x"], 1);
});

test("a refused change is told by field, stays undone, and takes no other with it", async () => {
  const { asked, store } = await loaded();
  /** @type {unknown[]} */
  const refusals = [];
  store.addEventListener("refused", (event) =>
    refusals.push(/** @type {CustomEvent} */ (event).detail),
  );
  const [, refused, unaffected] = await Promise.all([
    store.change({ "a.x": 3 }),
    store.change({ "a.x": 11 }),
    store.change({ "a.y": 7 }),
  ]);
  assert.deepEqual([refused, unaffected], [false, true]);
  assert.deepEqual(asked.at(-1), { "a.y": 7 });
  assert.deepEqual(refusals, [{ "a.x": "must be below 10" }]);
  await store.changeUndoably({ "a.x": 12 });
  assert.equal(store.canUndo, false);
});

test("help names other parameters as their fields are titled", async () => {
  const { store } = await loaded();
  assert.equal(store.schema[1]?.help, "Above Width.");
});

test("reset goes to the preset that the values come from, over what is declared", async () => {
  const { store } = await loaded();
  assert.deepEqual(store.defaults, { "a.x": 1, "a.y": 5 });
  assert.deepEqual(store.changed, ["a.y"]);
  await store.change(store.differing(store.defaults));
  assert.deepEqual(store.changed, []);
  const paper = store.findPreset("paper");
  assert.ok(paper);
  await store.choose(paper);
  assert.equal(store.basePreset?.name, "paper");
  assert.deepEqual(store.defaults, { "a.x": 8, "a.y": 2 });
  await store.change({ "a.x": 3 });
  assert.deepEqual(store.changed, ["a.x"]);
});

test("undo brings back the preset too, and one step can be taken back behind others", async () => {
  const { store } = await loaded();
  const paper = store.findPreset("paper");
  assert.ok(paper);
  const step = await store.choose(paper);
  await store.undo();
  assert.deepEqual([store.basePreset?.name, store.state.values["a.x"]], ["default", 1]);
  await store.redo();
  assert.deepEqual([store.basePreset?.name, store.state.values["a.x"]], ["paper", 8]);
  await store.changeUndoably({ "a.y": 9 });
  assert.ok(step);
  await store.revert(step);
  assert.equal(store.basePreset?.name, "default");
  assert.deepEqual(store.state.values, { "a.x": 1, "a.y": 9 });
  await store.undo();
  assert.deepEqual(store.state.values, { "a.x": 8, "a.y": 9 });
});

test("what is about no field is said once, however much was asked for", async () => {
  const { store } = await loaded();
  /** @type {unknown[]} */
  const refusals = [];
  store.addEventListener("refused", (event) =>
    refusals.push(/** @type {CustomEvent} */ (event).detail),
  );
  globalThis.fetch = () => Promise.reject(new TypeError("no network"));
  await store.change({ "a.x": 3, "a.y": 4 });
  await store.change({ "a.x": 3 });
  const sentence = "The server is not responding. Try again when it is back.";
  assert.deepEqual(refusals, [{ "": sentence }, { "a.x": sentence }]);
});

test("somebody else's change is read where the revision is another", async () => {
  const { store } = await loaded();
  const other = new ParameterStore();
  await other.load();
  await other.change({ "a.x": 8 });
  await store.follow(1, 0);
  assert.equal(store.state.values["a.x"], 1);
  await store.follow(2, 0);
  assert.equal(store.state.values["a.x"], 8);
});
