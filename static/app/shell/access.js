/** What this browser may do: an operator changes things, a read-only link watches. */

import { request } from "./api.js";

/** @import { SessionNow } from "../contract" */

/** @type {Promise<SessionNow["access"]> | null} */
let asked = null;

/**
 * What this browser may do; it is asked for once. Where the server does not tell, it is taken for an
 * operator's: the server refuses all the same what it does not allow.
 */
export function access() {
  asked ??= request("GET", "/session").then(
    (told) => /** @type {SessionNow} */ (told).access,
    () => "operator",
  );
  return asked;
}
