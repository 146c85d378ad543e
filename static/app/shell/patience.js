/** How long the page waits for the server's answer, by route. */

const SECOND_MS = 1000;
const MINUTE_MS = 60 * SECOND_MS;

export const USUAL_MS = 30 * SECOND_MS;
// The operator must soon be told to reach for the hardware switch.
const STOP_MS = 5 * SECOND_MS;
// The engine may have to prepare itself before it opens a source, and other changes wait for that.
const LONG_MS = 5 * MINUTE_MS;
// Slightly more than the server allows for a file of a run.
const FILE_MS = 31 * MINUTE_MS;

/**
 * The first that matches "METHOD /path" counts.
 *
 * @type {[RegExp, number][]}
 */
const ROUTES = [
  [/^POST \/robots\/stop$/, STOP_MS],
  [/^GET \/runs\/[^/]+\/(export|video|report|chart\.)/, FILE_MS],
  // Worked out when asked for.
  [/^GET \/runs\/[^/]+\/(chart|frames)/, LONG_MS],
  [/^GET \/(steps|boards|pixel|calibrations\/[^/]+\/preview)\b/, LONG_MS],
  // Whatever changes or uses the source: one at a time, and opening it takes long.
  [/^(PUT|POST) \/(source|playback|truth\/live|recording)\b/, LONG_MS],
  [/^(POST|DELETE) \/runs\b/, LONG_MS],
  [/^(PUT|POST|PATCH|DELETE) \/(calibrating|calibrations|comparison|parameters|rig)\b/, LONG_MS],
];

/**
 * @param {string} method
 * @param {string} path below /api
 * @param {unknown} [body] an upload takes as long as the network needs
 * @returns {number} milliseconds; infinite for an upload
 */
export function patienceMs(method, path, body) {
  if (body instanceof FormData) return Infinity;
  const route = `${method} ${path}`;
  return ROUTES.find(([pattern]) => pattern.test(route))?.[1] ?? USUAL_MS;
}
