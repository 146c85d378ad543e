import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { buttonOf, settled } from "../fake-page.mjs";
import { parameter } from "../made.mjs";

/** @import { Hub } from "../../../static/app/shell/hub.js" */
/** @import { Values } from "../../../static/app/parameters/parameter-store.js" */

mock.timers.enable({ apis: ["setTimeout", "setInterval"] });
const replaceState = (/** @type {string[]} */ ...[, , hash]) => {
  location.hash = hash ?? "";
};
Object.assign(globalThis, { history: { replaceState } });
const { StepPicture } = await import("../../../static/app/method/step-picture.js");
mock.method(StepPicture.prototype, "show", async () => false);
const { StepsView } = await import("../../../static/app/method/steps-view.js");

const NAME = "flow.window_px";
const PRESET = { [NAME]: 15, "ego_motion.model": "affine" };
const ENTRY = parameter({ name: NAME });

/** The server's answer. @param {number} frame @param {Values} [changes] */
function answer(frame, changes = {}) {
  return {
    source: "simulated:lab",
    frame,
    frame_count: 100,
    first_frame: 0,
    time: 1,
    dt: 0.1,
    preset: "paper",
    preset_values: PRESET,
    values: { ...PRESET, ...changes },
    models: ["affine"],
    truth: false,
    steps: [
      {
        number: 1,
        key: "flow",
        title: "Flow",
        text: "",
        caption: "",
        formula: [],
        numbers: [],
        missing: null,
        parameters: [NAME],
      },
    ],
  };
}

/** A page, and its requests for steps, each answered by the test. */
function asking() {
  /** @type {{url: string, answer: (told: unknown, status?: number) => void}[]} */
  const asked = [];
  const fetched = async (/** @type {string} */ url) => {
    if (url.startsWith("/api/steps?"))
      return new Promise((resolve) =>
        asked.push({
          url,
          answer: (told, status = 200) => resolve(Response.json(told, { status })),
        }),
      );
    if (url === "/api/parameters/schema") return Response.json([ENTRY]);
    if (url === "/api/parameters") return Response.json({ values: PRESET });
    return Response.json(url.startsWith("/api/history") ? { runs: [] } : []);
  };
  globalThis.fetch = /** @type {typeof fetch} */ (/** @type {unknown} */ (fetched));
  const view = new StepsView();
  view.attach(/** @type {Hub} */ (/** @type {unknown} */ (new EventTarget())));
  const open = (/** @type {number} */ frame, source = "simulated:lab") => {
    location.hash = `#steps/1?source=${source}&frame=${frame}&preset=paper`;
    view.show(location.hash);
  };
  return { view, asked, open };
}

/** A page at frame 40. */
async function shown() {
  const { view, asked, open } = asking();
  open(40);
  await settled();
  asked[0]?.answer(answer(40));
  await settled();
  return { view, asked, open };
}

test("what was chosen is not replaced by the answer to an earlier choice", async () => {
  const { view, asked, open } = await shown();
  open(41);
  const slider = [...view.querySelectorAll("input")].find(
    (each) => each.getAttribute("type") === "range",
  );
  if (!slider) throw new Error("no slider");
  Object.assign(slider, { value: "50" });
  slider.dispatchEvent(new Event("input"));
  asked[1]?.answer(answer(41));
  await settled();
  assert.match(location.hash, /frame=50/);
  mock.timers.tick(150);
  await settled();
  assert.match(String(asked[2]?.url), /frame=50/);
});

test("a field keeps the value just entered until the answer, and falls back if it is refused", async () => {
  const { view, asked } = await shown();
  const text = [...view.querySelectorAll("input")].find(({ id }) => id === "step-flow-window_px");
  if (!text) throw new Error("no field");
  text.value = "21";
  text.dispatchEvent(new Event("change"));
  mock.timers.tick(0);
  await settled();
  assert.equal(text.value, "21");
  asked[1]?.answer({ detail: [{ loc: ["query", NAME], msg: "must be odd" }] }, 422);
  await settled();
  assert.equal(text.value, "15");
  assert.ok(!location.hash.includes(NAME));
  const [error] = [...view.querySelectorAll("p")].filter(({ id }) => id.endsWith("px-error"));
  assert.equal(error?.textContent, "Not applied: must be odd. The value stays at 15.");
});

test("a link to a frame that does not exist says so and offers the nearest one", async () => {
  const { view, asked, open } = asking();
  open(99999, "simulated:people");
  await settled();
  const [source] = view.querySelectorAll("select");
  const heading = () => view.querySelector("h3")?.textContent;
  assert.deepEqual([source?.value, heading()], ["simulated:people", "Loading…"]);
  const msg = "simulated:people has no frame 99999; its frames are 0 to 179";
  asked[0]?.answer({ detail: [{ loc: ["query", "frame"], msg, type: "value" }] }, 422);
  await settled();
  assert.equal(heading(), "These frames cannot be shown");
  assert.match(view.textContent, /2Features3Matches/);
  buttonOf(view, "Go to frame 179").fire("click");
  mock.timers.tick(0);
  await settled();
  assert.match(String(asked[1]?.url), /frame=179/);
});
