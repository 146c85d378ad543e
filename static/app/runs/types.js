/**
 * What the server says of kept runs and of truth, by the names that the page uses; see
 * `../types.js`.
 *
 * @typedef {import("../contract").Run} Run
 * @typedef {import("../contract").History} History
 *
 * @typedef {object} TruthBody what was understood of one body of a truth file
 * @property {string} name
 * @property {boolean} has_orientation
 * @property {number} samples
 * @property {number} seen
 * @property {number} gaps
 * @property {number | null} from_s
 * @property {number | null} to_s
 * @property {number[] | null} extent_m along the room's axes
 * @property {number | null} highest_speed_mps
 *
 * @typedef {object} TruthFile answer of POST /api/truth
 * @property {string} id
 * @property {string} name
 * @property {string} format
 * @property {{format: string, rate_hz: number | null, duration_s: number | null,
 *   bodies: TruthBody[], notes: string[]}} info
 * @property {string} created_at ISO 8601
 *
 * @typedef {import("../contract").AlignmentMatch} Match
 * @typedef {import("../contract").CameraOnBodyFacts} CameraPlace
 * @typedef {import("../contract").AlignmentFacts} Alignment
 * @typedef {import("../contract").ChartCurve} Curve
 * @typedef {import("../contract").RunChart} Chart
 */

export {};
