/** The REST interface under /api: one function to call, one error to catch. */

import { sentence } from "../elements/words.js";
import { patienceMs } from "./patience.js";
import { goToSignIn } from "./session.js";

/**
 * A request was refused or did not arrive. `message` is one sentence for the user; `fields` has a
 * sentence for each refused field, by the last part of its `loc`.
 */
export class ApiError extends Error {
  /**
   * @param {string} message
   * @param {number} status 0 if the server did not answer
   * @param {Record<string, string>} fields
   */
  constructor(message, status, fields = {}) {
    super(message);
    this.name = "ApiError";
    this.status = status;
    this.fields = fields;
  }
}

/** The caller itself aborted the request: nothing failed, so there is nothing to say. */
export class Aborted extends Error {
  constructor() {
    super("The request was aborted.");
    this.name = "Aborted";
  }
}

/**
 * @template T
 * @param {"GET" | "POST" | "PUT" | "PATCH" | "DELETE"} method
 * @param {string} path below /api, as in "/runs"
 * @param {unknown} [body] sent as JSON, or as is if it is FormData
 * @returns {Promise<T>} the answer's JSON, or null if it has none
 * @throws {ApiError}
 */
export function request(method, path, body) {
  return send(method, path, body, undefined, (response) => {
    const type = response.headers.get("content-type") ?? "";
    // An answer without content may still be labelled JSON.
    const empty = response.status === 204;
    return !type.includes("json") || empty ? null : response.json();
  });
}

/**
 * Fetch an image or another file together with its headers.
 *
 * @param {string} path below /api
 * @param {AbortSignal} [signal] aborts it; the server then stops making the file
 * @returns {Promise<{blob: Blob, headers: Headers}>}
 * @throws {ApiError}
 * @throws {Aborted}
 */
export function requestImage(path, signal) {
  return send("GET", path, undefined, signal, async (response) => {
    return { blob: await response.blob(), headers: response.headers };
  });
}

/**
 * @param {string} method
 * @param {string} path
 * @param {unknown} body
 * @param {AbortSignal | undefined} signal
 * @param {(response: Response) => unknown} read returns the content of an answer that is no refusal
 * @returns {Promise<any>} that content
 */
async function send(method, path, body, signal, read) {
  if (signal?.aborted) throw new Aborted();
  const form = body instanceof FormData;
  const ending = new AbortController();
  const end = () => ending.abort();
  /** @type {RequestInit} */
  const options = { method, credentials: "same-origin", cache: "no-store", signal: ending.signal };
  if (body !== undefined) {
    options.body = form ? body : JSON.stringify(body);
    if (!form) options.headers = { "content-type": "application/json" };
  }
  const patience = patienceMs(method, path, body);
  const timer = patience < Infinity ? setTimeout(end, patience) : undefined;
  signal?.addEventListener("abort", end);
  try {
    const response = await fetch(`/api${path}`, options);
    if (response.ok) return await read(response);
    if (response.status === 401) goToSignIn();
    throw refusal(response.status, await response.json().catch(() => null));
  } catch (error) {
    if (error instanceof ApiError) throw error;
    if (signal?.aborted) throw new Aborted();
    // Also where the connection was lost before the whole answer arrived.
    throw ending.signal.aborted ? unanswered(method, patience) : unreachable();
  } finally {
    clearTimeout(timer);
    signal?.removeEventListener("abort", end);
  }
}

function unreachable() {
  return new ApiError("The server is not responding. Try again when it is back.", 0);
}

/** @param {string} method @param {number} patience milliseconds */
function unanswered(method, patience) {
  const seconds = patience / 1000;
  const time = seconds < 120 ? `${seconds} s` : `${seconds / 60} min`;
  const next =
    method === "GET" ? "Try again later." : "It may still do what was asked: look before retrying.";
  return new ApiError(`The server did not answer within ${time}. ${next}`, 0);
}

/**
 * @param {number} status
 * @param {unknown} body what the server answered: {"detail": sentence or list of loc and msg}
 */
function refusal(status, body) {
  const detail = body && typeof body === "object" && "detail" in body ? body.detail : null;
  if (typeof detail === "string") return new ApiError(sentence(detail), status);
  /** @type {Record<string, string>} */
  const fields = {};
  if (Array.isArray(detail)) {
    for (const entry of detail) {
      if (entry && typeof entry.msg === "string") {
        const loc = Array.isArray(entry.loc) ? entry.loc : [];
        fields[String(loc.at(-1) ?? "")] = entry.msg;
      }
    }
  }
  const first = Object.values(fields)[0];
  return new ApiError(
    sentence(first ?? `The server refused the request (${status}).`),
    status,
    fields,
  );
}
