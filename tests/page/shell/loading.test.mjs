import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

const APP = new URL("../../../static/app/", import.meta.url);
const PAGE = readFileSync(new URL("../index.html", APP), "utf8");
const MAIN = read("main.js");
const FIRST = loadedBy("main.js");
// Each module delays the first painted frame.
const MOST_BEFORE_IT = 60;

/** @param {string} name below static/app */
function read(name) {
  return readFileSync(new URL(name, APP), "utf8");
}

/** @param {string} name @returns {string[]} it and the modules it imports, directly or not */
function loadedBy(name) {
  const found = new Set([name]);
  for (const each of found)
    for (const [, other = ""] of read(each).matchAll(/^(?:import|\}|export) ?[^;]*?"(\.[^"]+)";/gm))
      found.add(new URL(other, new URL(each, APP)).href.slice(APP.href.length));
  return [...found];
}

test("the page loads ahead what its first module imports, and nothing else", () => {
  const links = FIRST.slice(1)
    .sort()
    .map((name) => `    <link rel="modulepreload" href="/static/app/${name}" />`);
  const found = PAGE.split("\n").filter((line) => line.includes("modulepreload"));
  assert.deepEqual(found, links, `index.html shall have:\n${links.join("\n")}\n`);
  assert.ok(FIRST.length <= MOST_BEFORE_IT, `${FIRST.length} modules`);
});

test("what stops robots is loaded first", () => {
  const needed = ["stop-bar.js", "stop-keys.js", "driver.js", "drive-link.js", "hold.js"];
  for (const name of [...needed.map((name) => `driving/${name}`), "shell/live-socket.js"])
    assert.ok(FIRST.includes(name), name);
});

test("each part of the page is loaded, first or later", () => {
  const later = new Map(
    [...MAIN.matchAll(/^ {2}(?:"([\w-]+)"|\[(\w+)\]): \(\) => import\("\.\/([^"]+)"\)/gm)].map(
      ([, name, constant, file]) => [name ?? valueOf(constant), file ?? ""],
    ),
  );
  const parts = [...PAGE.matchAll(/<(observer-[\w-]+)[^>]* data-part/g)].map(([, name]) => name);
  assert.ok(parts.length > 20);
  for (const name of parts) {
    const defines = (/** @type {string} */ file) => read(file).includes(`define("${name}"`);
    const file = later.get(name);
    assert.ok(FIRST.some(defines) !== (file !== undefined), `${name} is loaded first or later`);
    if (file !== undefined) assert.ok(defines(file), `${file} defines ${name}`);
  }
  for (const name of later.keys()) assert.ok(parts.includes(name), `${name} is in the page`);
});

/** @param {string | undefined} constant of main.js */
function valueOf(constant) {
  return MAIN.match(new RegExp(`^const ${constant} = "([\\w-]+)";`, "m"))?.[1];
}
