import assert from "node:assert/strict";
import { test } from "node:test";

import { LatestRequest } from "../../../static/app/elements/latest-request.js";

test("a slow first answer does not overwrite a newer one", async () => {
  const newest = new LatestRequest();
  /** @type {(answer: string) => void} */
  let late = () => {};
  const first = newest.run(() => new Promise((resolve) => (late = resolve)));
  const second = newest.run(async () => "two cameras");
  assert.equal(await second, "two cameras");
  late("no camera");
  assert.equal(await first, undefined);
});

test("a late failure is as little news; the newest one is told", async () => {
  const newest = new LatestRequest();
  /** @type {(reason: Error) => void} */
  let fail = () => {};
  const first = newest.run(() => new Promise((_, reject) => (fail = reject)));
  const second = newest.run(async () => {
    throw new Error("gone");
  });
  fail(new Error("late"));
  assert.equal(await first, undefined);
  await assert.rejects(second, (error) => error.message === "gone");
});
