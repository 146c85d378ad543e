import assert from "node:assert/strict";
import { test } from "node:test";

import { Emitter } from "../../../static/app/shell/emitter.js";
import { partOf, serve, settled } from "../fake-page.mjs";
import { robots } from "../made.mjs";

await import("../../../static/app/driving/programmes.js");
await import("../../../static/app/calibration/calibration-panel.js");

/** The shown sentences of an empty list. @param {any} part @returns {string[]} */
function emptyWords(part) {
  return part
    .querySelectorAll("p")
    .filter((/** @type {any} */ each) => each.className === "empty" && !each.hidden)
    .map((/** @type {any} */ each) => String(each.textContent));
}

for (const [name, path, words] of /** @type {const} */ ([
  ["observer-programmes", "/programmes", /^No programmes found/],
  ["observer-calibration", "/calibrations", /^No saved calibrations/],
])) {
  test(`${name} calls its list empty only once the server has said so`, async () => {
    let down = true;
    serve((_, asked) => (asked === path && down ? new Error("it is restarting") : []));
    const driver = Object.assign(new Emitter(), { robot: () => null, link: { leases: new Map() } });
    const hub = Object.assign(new Emitter(), { driver, robots: robots(), status: null });
    const part = partOf(name);
    part.attach(hub);
    await settled();
    assert.deepEqual(emptyWords(part), []);
    down = false;
    hub.emit("robots");
    hub.emit("reconnected");
    await settled();
    assert.equal(emptyWords(part).length, 1);
    assert.match(emptyWords(part)[0] ?? "", words);
  });
}
