import assert from "node:assert/strict";
import { test } from "node:test";

import { speedsAsCsv } from "../../../static/app/chart/live-speed-files.js";

test("speeds are saved on the source's clock, without gaps and what is out of sight", async () => {
  /** @type {import("../../../static/app/chart/speed-curves.js").Curve} */
  const curve = {
    key: "k",
    kind: "estimate",
    label: 'Obstacle "1"',
    colour: "",
    banded: true,
    times: [1, 2, 3, 4],
    speeds: [0.1, 0.2, null, 0.4],
    stds: [0.01, null, null, 0.01],
  };
  const text = await speedsAsCsv([curve], { begin: 2, end: 3, offset: 0.5 }).text();
  assert.deepEqual(text.split("\n"), [
    "source,label,time_s,speed_mps,std_mps",
    'estimate,"Obstacle ""1""",1.5000,0.20000,',
    "",
  ]);
});
