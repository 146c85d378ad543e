import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { Aborted, ApiError, request, requestImage } from "../../../static/app/shell/api.js";
import { patienceMs, USUAL_MS } from "../../../static/app/shell/patience.js";

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

/** Answer no request until it is aborted, as a hung server. */
function hangs() {
  const fetched = (/** @type {string} */ _, /** @type {RequestInit} */ { signal }) =>
    new Promise((_, reject) => {
      signal?.addEventListener("abort", () => reject(new DOMException("aborted", "AbortError")));
    });
  globalThis.fetch = /** @type {typeof fetch} */ (/** @type {unknown} */ (fetched));
}

test("a server that hangs is given up, in words that fit what was asked", async () => {
  hangs();
  mock.timers.enable({ apis: ["setTimeout"] });
  const late = "The server did not answer within 30 s.";
  /** @param {string} next @returns {(error: any) => boolean} */
  const says = (next) => (error) =>
    error instanceof ApiError && error.message === `${late} ${next}` && error.status === 0;
  const given = [
    assert.rejects(request("GET", "/presets"), says("Try again later.")),
    assert.rejects(
      request("POST", "/programmes", {}),
      says("It may still do what was asked: look before retrying."),
    ),
  ];
  mock.timers.tick(USUAL_MS);
  await Promise.all(given);
  mock.timers.reset();
});

test("what takes long is waited for longer, and an upload as long as it takes", () => {
  assert.equal(patienceMs("GET", "/session"), USUAL_MS);
  for (const [method = "", path = ""] of [
    ["PUT", "/source"],
    ["POST", "/runs"],
    ["POST", "/recording/clips"],
    ["POST", "/calibrating/compute"],
    ["GET", "/steps/3.png?frame=1"],
    ["GET", "/runs/r1/export?format=mp4"],
  ])
    assert.ok(patienceMs(method, path) > USUAL_MS, path);
  assert.ok(patienceMs("GET", "/runs/r1/chart.pdf") > patienceMs("GET", "/runs/r1/chart"));
  assert.ok(patienceMs("POST", "/robots/stop") < USUAL_MS);
  assert.equal(patienceMs("POST", "/truth", new FormData()), Infinity);
});

test("an aborted request is no outage", async () => {
  hangs();
  const stop = new AbortController();
  const isAborted = (/** @type {unknown} */ error) => error instanceof Aborted;
  const asked = assert.rejects(requestImage("/runs/r1/export", stop.signal), isAborted);
  stop.abort();
  await asked;
  await assert.rejects(requestImage("/runs/r1/export", stop.signal), isAborted);
});
