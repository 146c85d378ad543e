/**
 * What the server says, by the names that the page uses. What a name holds is declared once, in
 * `app/contract`, of which `contract.d.ts` is made. Units are in the names or beside them.
 *
 * @typedef {"number" | "integer" | "boolean" | "choice"} ParameterType
 * @typedef {number | boolean | string} ParameterValue
 * @typedef {Record<string, ParameterValue>} ParameterValues
 *
 * @typedef {Omit<import("./contract").ParameterEntry, "default" | "minimum" | "maximum" | "step"> &
 *   {default: ParameterValue, minimum?: number, maximum?: number, step?: number}} ParameterEntry
 *   one line of GET /api/parameters/schema; only numbers have a range
 * @typedef {Omit<import("./contract").ParametersNow, "values"> & {values: ParameterValues}} ParameterState
 *   answer of GET and PATCH /api/parameters
 * @typedef {Omit<import("./contract").Preset, "values"> & {values: ParameterValues}} Preset
 *
 * @typedef {import("./contract").ObstacleEntry} Obstacle
 * @typedef {import("./contract").TrueBodyEntry} TrueBody
 * @typedef {import("./contract").ObservationLine} Line one observation
 * @typedef {import("./contract").ObservationMessage} ObservationMessage
 * @typedef {import("./contract").PlaybackStatus} Playback
 * @typedef {import("./contract").SourceStatus} SourceInfo
 * @typedef {import("./contract").EgoMotionStatus} EgoMotion
 * @typedef {import("./contract").Pixel} PixelAnswer
 * @typedef {import("./contract").CapturedView} CapturedView
 * @typedef {import("./contract").BoardLook} BoardLook
 * @typedef {import("./contract").CalibratingFacts} Calibrating
 * @typedef {import("./contract").RowDriftStatus} RowDrift
 * @typedef {import("./contract").TapeCheck} TapeCheck
 * @typedef {import("./contract").LiveCamera} LiveCamera
 * @typedef {import("./contract").LiveStatus} Live
 * @typedef {import("./contract").LiveTruthStatus} LiveTruth
 * @typedef {import("./contract").RecordingStatus} Recording
 * @typedef {import("./contract").Status} Status
 * @typedef {import("./contract").SourceEntry} SourceChoice
 * @typedef {import("./contract").Run} Run
 * @typedef {Omit<import("./contract").Calibration, "report"> &
 *   {report: Record<string, any> | null}} Calibration
 *
 * @typedef {"connecting" | "open" | "closed"} Connection
 *
 * @typedef {object} Freshness how old what the page shows is
 * @property {"fresh" | "held" | "stale" | "none"} state held: paused or ended on purpose
 * @property {string} reason one sentence, empty while fresh
 * @property {number} age_s
 */

export {};
