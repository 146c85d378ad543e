/** What buttons of the robots' tab ask of the server. */

import { notifyError } from "../notice.js";

/**
 * One action at a time: what is pressed while another goes on is left out, and what went wrong is
 * told.
 *
 * @param {() => void} [after] called whatever came of it
 * @returns {(action: () => unknown) => Promise<void>}
 */
export function oneAtATime(after = () => {}) {
  let busy = false;
  return async (action) => {
    if (busy) return;
    busy = true;
    try {
      await action();
    } catch (error) {
      notifyError(error);
    } finally {
      busy = false;
      after();
    }
  };
}
