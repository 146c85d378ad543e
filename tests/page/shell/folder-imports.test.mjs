import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";

const APP = new URL("../../../static/app/", import.meta.url);

/** What each folder may import besides itself; by default elements and shell. @type {Record<string, string[]>} */
const ALLOWED = {
  elements: [],
  shell: ["elements"],
  // It belongs to another page, with nothing of this one.
  "scene-frame": [],
  calibration: ["elements", "shell", "live", "sources"],
  driving: ["elements", "shell", "parameters"],
  live: ["elements", "shell", "parameters"],
  runs: ["elements", "shell", "chart", "parameters"],
  sources: ["elements", "shell", "runs"],
  method: ["elements", "shell", "parameters", "runs", "sources"],
  pages: ["elements", "shell", "method", "runs"],
};

test("places of the page import one way", () => {
  const files = readdirSync(APP, { recursive: true }).filter((name) => /.\/.+\.js$/.test(name));
  assert.ok(files.length > 50);
  for (const name of files) {
    const [place = ""] = name.split("/");
    const allowed = [place, ...(ALLOWED[place] ?? ["elements", "shell"])];
    const text = readFileSync(new URL(name, APP), "utf8");
    for (const [, other = ""] of text.matchAll(/^(?:import|\}) [^;]*?"\.\.\/([\w-]+)\//gm))
      assert.ok(allowed.includes(other), `${name} imports ${other}`);
  }
});
