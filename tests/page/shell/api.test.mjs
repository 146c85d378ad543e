import assert from "node:assert/strict";
import { test } from "node:test";

import { ApiError, request } from "../../../static/app/shell/api.js";

/** Set the server's answer to the next request. @param {() => Response} answer */
function answers(answer) {
  /** @type {{url: string, options: RequestInit}[]} */
  const asked = [];
  const fetched = async (/** @type {string} */ url, /** @type {RequestInit} */ options) => {
    asked.push({ url, options });
    return answer();
  };
  globalThis.fetch = /** @type {typeof fetch} */ (/** @type {unknown} */ (fetched));
  return asked;
}

/** @param {unknown} body @param {number} status */
const refusing = (body, status) => () => Response.json(body, { status });

test("a body goes as JSON and the answer comes as what it holds", async () => {
  const asked = answers(() => Response.json({ id: "r1" }));
  assert.deepEqual(await request("POST", "/runs", { name: "first" }), { id: "r1" });
  assert.equal(asked[0]?.url, "/api/runs");
  assert.equal(asked[0]?.options.body, '{"name":"first"}');
  assert.deepEqual(asked[0]?.options.headers, { "content-type": "application/json" });
});

test("an answer without content is null, though it may be called JSON", async () => {
  const headers = { "content-type": "application/json" };
  answers(() => new Response(null, { status: 204, headers }));
  assert.equal(await request("DELETE", "/runs/r1"), null);
});

test("an answer that breaks off counts as a server that is not responding", async () => {
  const headers = { "content-type": "application/json" };
  answers(() => new Response('{"id": "r', { headers }));
  await assert.rejects(
    request("GET", "/runs/r1"),
    (error) => error instanceof ApiError && error.status === 0,
  );
});

test("a refusal is one sentence, and one for each field", async () => {
  answers(refusing({ detail: "a run is on" }, 409));
  await assert.rejects(
    request("POST", "/runs"),
    (error) =>
      error instanceof ApiError && error.message === "A run is on." && error.status === 409,
  );
  answers(refusing({ detail: [{ loc: ["body", "a.x"], msg: "must be below 10" }] }, 422));
  await assert.rejects(
    request("PATCH", "/parameters", { "a.x": 11 }),
    (error) => error.message === "Must be below 10." && error.fields["a.x"] === "must be below 10",
  );
});

test("an answer that is no JSON, and a server that is gone, are told in words", async () => {
  answers(() => new Response("<html>", { status: 502 }));
  await assert.rejects(
    request("GET", "/runs"),
    (error) => error.message === "The server refused the request (502).",
  );
  answers(() => {
    throw new TypeError("network");
  });
  await assert.rejects(request("GET", "/runs"), (error) => error.status === 0);
});
