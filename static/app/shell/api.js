/** The REST interface under /api: one function to call, one error to catch. */

import { sentence } from "../elements/words.js";
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

/**
 * @template T
 * @param {"GET" | "POST" | "PUT" | "PATCH" | "DELETE"} method
 * @param {string} path below /api, as in "/runs"
 * @param {unknown} [body] sent as JSON, or as is if it is FormData
 * @returns {Promise<T>} the answer's JSON, or null if it has none
 * @throws {ApiError}
 */
export async function request(method, path, body) {
  const response = await send(method, path, body);
  const type = response.headers.get("content-type") ?? "";
  // An answer without content may still be labelled JSON.
  const empty = response.status === 204;
  if (!type.includes("json") || empty) return /** @type {T} */ (null);
  try {
    return await response.json();
  } catch {
    // The connection was lost before the whole answer arrived.
    throw unreachable();
  }
}

/**
 * Fetch an image or another file together with its headers.
 *
 * @param {string} path below /api
 * @param {AbortSignal} [signal] aborts it; the server then stops making the file
 * @returns {Promise<{blob: Blob, headers: Headers}>}
 * @throws {ApiError}
 */
export async function requestImage(path, signal) {
  const response = await send("GET", path, undefined, signal);
  try {
    return { blob: await response.blob(), headers: response.headers };
  } catch {
    throw unreachable();
  }
}

/**
 * @param {string} method
 * @param {string} path
 * @param {unknown} [body]
 * @param {AbortSignal} [signal]
 */
async function send(method, path, body, signal) {
  const form = body instanceof FormData;
  /** @type {RequestInit} */
  const options = { method, credentials: "same-origin", cache: "no-store" };
  if (signal) options.signal = signal;
  if (body !== undefined) {
    options.body = form ? body : JSON.stringify(body);
    if (!form) options.headers = { "content-type": "application/json" };
  }
  let response;
  try {
    response = await fetch(`/api${path}`, options);
  } catch {
    throw unreachable();
  }
  if (response.ok) return response;
  if (response.status === 401) goToSignIn();
  throw refusal(response.status, await response.json().catch(() => null));
}

function unreachable() {
  return new ApiError("The server is not responding. Try again when it is back.", 0);
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
