/**
 * What the server says of kept runs and of truth, as types; see /docs for the same in full.
 *
 * @typedef {import("../types.js").Run} Run
 *
 * @typedef {object} History answer of GET /api/history
 * @property {Run[]} runs newest first
 * @property {number} total how many there are of what was asked for
 * @property {Record<string, number>} tags how many runs have each
 * @property {{used_bytes: number, free_bytes: number}} disk
 * @property {number} undo_days for how long a deleted run can be brought back
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
 * @typedef {object} Match which body a track is
 * @property {string | null} body null: none
 * @property {"position" | "speed" | "person"} by
 * @property {number | null} distance_m
 *
 * @typedef {{x_m: number, y_m: number, z_m: number, pan_deg: number, tilt_deg: number, roll_deg: number}} CameraPlace
 *   the camera in the axes of the body that carries it
 *
 * @typedef {object} Alignment how truth was laid over a run
 * @property {number} offset_s to be added to truth's times
 * @property {number} sigma_s
 * @property {number} drift_ppm
 * @property {number | null} drift_sigma_ppm
 * @property {number} correlation
 * @property {number} overlap_s
 * @property {number} residual_mps
 * @property {number} samples
 * @property {string | null} observer the body that carries the camera
 * @property {CameraPlace | null} camera_on_body null: not known
 * @property {Record<string, string>} roles observer or obstacle, by the body's name
 * @property {number | null} frame_residual_m null: only the clocks are aligned
 * @property {Record<string, Match>} matches by "segment:track"
 * @property {string[]} notes
 *
 * @typedef {object} Curve of GET /api/runs/{id}/chart
 * @property {"estimate" | "truth" | "commanded" | "encoder"} kind
 * @property {string} label
 * @property {string} role
 * @property {number | null} track_id
 * @property {string | null} body
 * @property {number | null} segment null: of the whole run
 * @property {number[]} times seconds
 * @property {(number | null)[]} speeds m/s
 * @property {(number | null)[] | null} stds m/s
 *
 * @typedef {object} Chart answer of GET /api/runs/{id}/chart
 * @property {Run} run
 * @property {boolean} aligned
 * @property {string | null} sentence
 * @property {Alignment | null} alignment
 * @property {{observer: string | null, ignore: string[], matches: Record<string, string | null>,
 *   expected_offset_s: number | null, camera_on_body: CameraPlace | null} | null} choices what was said for it
 * @property {Curve[]} curves
 * @property {{time: number, body: string, before: string, after: string}[]} changes
 * @property {Record<string, any>[]} errors
 */

export {};
