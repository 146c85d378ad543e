/** Whether the computer keeps up with its source, in words. Pure function. */

/** @import { Status } from "../contract" */

// Below this share of the requested rate, it does not keep up.
const KEEPING_UP = 0.9;

/**
 * @param {Pick<Status, "playback" | "live" | "source" | "rates">} status
 * @returns {string} as in "this computer is too slow: 0.4 × real time", empty while it keeps up
 */
export function paceWarning({ playback, live, source, rates }) {
  const seen = rates.unique_frames_per_s;
  const reduced = live?.reduced_to ? `reduced to ${live.reduced_to}` : null;
  if (live && source && seen > 0 && seen < KEEPING_UP * source.frame_rate) {
    const share = `${seen.toFixed(1)} of ${source.frame_rate.toFixed(0)} fps`;
    return ["this computer is too slow: " + share, reduced].filter(Boolean).join(", ");
  }
  if (reduced) return `this computer is too slow for full processing: ${reduced}`;
  const { achieved_rate: achieved, rate = 1, paused, ended } = playback ?? {};
  if (live || paused || ended || !achieved || achieved > KEEPING_UP * rate) return "";
  const wanted = rate === 1 ? "real time" : `real time, ${rate} × requested`;
  return `this computer is too slow: ${achieved.toFixed(1)} × ${wanted}`;
}
