/**
 * What the server says of kept runs and of truth, by the names that the page uses; see
 * `../types.js`.
 *
 * @typedef {import("../contract").Run} Run
 * @typedef {import("../contract").History} History
 * @typedef {import("../contract").TruthEntry} TruthFile
 * @typedef {import("../contract").AlignmentMatch} Match
 * @typedef {import("../contract").CameraOnBodyFacts} CameraPlace
 * @typedef {import("../contract").AlignmentFacts} Alignment
 * @typedef {import("../contract").ChartCurve} Curve
 * @typedef {import("../contract").RunChart} Chart
 */

export {};
