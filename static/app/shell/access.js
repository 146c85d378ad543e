/** What this browser may do: operators change things, read-only links watch. */

import { request } from "./api.js";

/** @import { SessionNow } from "../contract" */

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
