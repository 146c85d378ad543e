import assert from "node:assert/strict";
import { test } from "node:test";

import { FrameEntries } from "../../../static/app/runs/frame-entries.js";

const COUNT = 2500;
const timeOf = (/** @type {number} */ position) => position / 15 + (position >= 1203 ? 4 : 0);
const all = Array.from({ length: COUNT }, (_, frame) => ({
  frame,
  plan: { time: timeOf(frame) },
}));

const MAPS = [
  { first: 990, last: 1005 },
  { first: 1006, last: 1013 },
];

/** @type {string[]} */
let asked = [];
let refusing = false;
globalThis.fetch = /** @type {any} */ (
  async (/** @type {string} */ address) => {
    asked.push(address);
    const query = new URL(address, "http://here").searchParams;
    const first = Number(query.get("first") ?? 0);
    const end = Math.min(COUNT, first + Number(query.get("count") ?? COUNT));
    const every = Math.max(1, Math.ceil((end - first) / Number(query.get("most") ?? COUNT)));
    const frames = all.slice(first, end).filter((_, k) => k % every === 0);
    const told = {
      width: 640,
      height: 320,
      frames,
      first,
      every,
      count: COUNT,
      truth: false,
      maps: every === 1 ? MAPS.filter((map) => map.first < end && map.last >= first) : [],
    };
    return refusing
      ? new Response(JSON.stringify({ detail: "no" }), { status: 503 })
      : new Response(JSON.stringify(told), {
          headers: { "content-type": "application/json" },
        });
  }
);

async function read() {
  asked = [];
  refusing = false;
  return FrameEntries.of("an id");
}

test("a long run begins with frames that are spread over it", async () => {
  const entries = await read();
  assert.deepEqual(asked, ["/api/runs/an%20id/frames?most=1000"]);
  assert.equal(entries.count, COUNT);
  assert.equal(entries.spread.length, 834);
  assert.equal(entries.at(3)?.frame, 3);
  assert.equal(entries.at(4), null);
  assert.equal(entries.near(4)?.frame, 3);
  assert.equal(entries.near(COUNT - 1)?.frame, 2499);
});

test("every frame is read when it is wanted, once, with those around it", async () => {
  const entries = await read();
  assert.equal((await entries.fetch(1201))?.frame, 1201);
  assert.equal((await entries.fetch(1202))?.frame, 1202);
  assert.equal(asked.length, 2);
  assert.match(String(asked[1]), /first=1200&count=200$/);
  // The next page is prefetched.
  await entries.fetch(1301);
  assert.match(String(asked[2]), /first=1400&count=200$/);
  assert.equal((await entries.fetch(COUNT - 1))?.frame, COUNT - 1);
});

test("a second leads to its frame, exactly once that is read", async () => {
  const entries = await read();
  assert.ok(Math.abs(entries.positionAt(timeOf(401)) - 401) <= 1);
  for (const position of [1202, 1203, 1210]) {
    await entries.fetch(position);
    assert.equal(entries.positionAt(timeOf(position)), position);
    assert.equal(entries.timeAt(position), timeOf(position));
  }
  assert.equal(entries.positionAt(-5), 0);
  assert.equal(entries.positionAt(1e9), COUNT - 1);
});

test("what could not be read is asked for again", async () => {
  const entries = await read();
  refusing = true;
  assert.equal(await entries.fetch(4), null);
  refusing = false;
  assert.equal((await entries.fetch(4))?.frame, 4);
});

test("the local map that counts at a frame comes with the frames around it", async () => {
  const entries = await read();
  assert.equal(entries.mapAt(1001), null);
  await entries.fetch(1001);
  await entries.fetch(998);
  assert.deepEqual(
    [989, 990, 999, 1007, 1013, 1014].map((at) => entries.mapAt(at)?.first ?? null),
    [null, 990, 990, 1006, 1006, null],
  );
});
