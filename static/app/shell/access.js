/** What this browser may do: operators change things, read-only links watch. */

import { request } from "./api.js";

/** @import { SessionNow } from "../contract" */

/** Why a browser with read-only access cannot drive. */
export const READ_ONLY_WORDS = "This link is read-only: it cannot drive robots.";

/** @type {Promise<SessionNow["access"]> | null} */
let asked = null;

/**
 * Return the access of this browser, asking the server once. If that fails, assume an operator: the
 * server refuses forbidden requests anyway.
 */
export function access() {
  asked ??= request("GET", "/session").then(
    (answer) => /** @type {SessionNow} */ (answer).access,
    () => "operator",
  );
  return asked;
}

/** Whether the page already shows that this browser has read-only access. */
export function isReadOnly() {
  return document.documentElement.dataset.access === "read_only";
}
