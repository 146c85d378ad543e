/**
 * What the server says, as types. Units are in the names or beside them; see the REST
 * documentation at /docs for the same in full.
 *
 * @typedef {"number" | "integer" | "boolean" | "choice"} ParameterType
 * @typedef {number | boolean | string} ParameterValue
 *
 * @typedef {object} ParameterEntry one line of GET /api/parameters/schema
 * @property {string} name dotted, as in "ego_motion.ransac_threshold_px"
 * @property {string} group
 * @property {string} group_help
 * @property {string} title
 * @property {string} help
 * @property {ParameterType} type
 * @property {string} unit
 * @property {ParameterValue} default
 * @property {string[]} models with which ego_motion.model it acts on what is observed
 * @property {boolean} [cloud] whether it acts on the cloud with every model
 * @property {number} [minimum]
 * @property {number} [maximum]
 * @property {number} [step]
 * @property {string[]} [choices]
 *
 * @typedef {object} ParameterState answer of GET and PATCH /api/parameters
 * @property {number} revision
 * @property {number} guard_revision of `guard.*` alone
 * @property {Record<string, ParameterValue>} values
 * @property {string | null} preset
 * @property {number | null} frame the first frame these values act on
 *
 * @typedef {object} Preset
 * @property {string} name
 * @property {string} help
 * @property {Record<string, ParameterValue>} values
 * @property {boolean} built_in
 *
 * @typedef {object} Obstacle
 * @property {number} id
 * @property {"tentative" | "confirmed" | "coasting"} state
 * @property {"moving" | "stopped"} motion
 * @property {number[] | null} position world, metres
 * @property {number[] | null} velocity world, m/s
 * @property {number} speed m/s
 * @property {number | null} speed_std m/s, one standard deviation
 * @property {number} velocity_time seconds, source clock: the instant to which the speed belongs
 * @property {number} range metres
 * @property {number} bearing radians, positive to the right
 * @property {number | null} closing_speed m/s, positive while the range shrinks
 * @property {number} points
 * @property {number} significance standard deviations
 * @property {number[]} size metres
 * @property {string} [why]
 *
 * @typedef {object} TrueBody
 * @property {number} id
 * @property {string} name
 * @property {string} role
 * @property {number} speed m/s
 * @property {number | null} visible share that the left camera sees, 0 to 1
 * @property {number | null} commanded_speed m/s
 * @property {number | null} track_id the reported obstacle it was matched to
 *
 * @typedef {object} Line one observation
 * @property {number} frame
 * @property {number} time seconds, source clock
 * @property {number} segment
 * @property {"ok" | "degraded" | "lost"} status
 * @property {string[]} reasons
 * @property {number} parameters_revision
 * @property {{position: number[], orientation_wxyz: number[]} | null} pose
 * @property {Obstacle[]} obstacles
 * @property {Record<string, number>} timings_ms
 *
 * @typedef {object} ObservationMessage
 * @property {"observation"} type
 * @property {number} sequence
 * @property {Line} line
 * @property {TrueBody[]} truth
 * @property {number} age_ms
 *
 * @typedef {object} Playback
 * @property {boolean} paused
 * @property {number} rate
 * @property {boolean} loop
 * @property {number | null} frame
 * @property {number | null} frame_count
 * @property {boolean} ended
 * @property {boolean} seekable whether it can go on from any frame
 * @property {number | null} [achieved_rate] source seconds per second, measured
 *
 * @typedef {object} SourceInfo
 * @property {string} spec
 * @property {string} kind
 * @property {number} width
 * @property {number} height
 * @property {number} frame_rate
 * @property {number | null} frame_count
 * @property {boolean} live
 *
 * @typedef {object} EgoMotion from the frame that the newest one was compared with
 * @property {string} model
 * @property {"ok" | "degraded" | "lost"} status
 * @property {number} matches
 * @property {number} inliers
 * @property {number | null} dt seconds
 * @property {{translation_px: number[], rotation_rad: number, shear: number | null,
 *   scale: number[]} | null} decomposition of planar models
 * @property {{rotation_rad: number[], translation_m: number[]} | null} motion of the camera
 *
 * @typedef {object} PixelAnswer of GET /api/pixel
 * @property {number} frame
 * @property {number} segment
 * @property {number} u
 * @property {number} v
 * @property {string} verdict
 * @property {string} sentence
 * @property {Record<string, number | null>} numbers
 * @property {string} would_change
 * @property {{id: number, reported: boolean, why: string} | null} obstacle
 *
 * @typedef {object} CapturedView
 * @property {string} name
 * @property {number} left corners seen
 * @property {number} right
 * @property {boolean} picture whether there is a small image of it
 *
 * @typedef {object} BoardLook what was made of the newest pair
 * @property {string} words
 * @property {string | null} [next] where to hold the board next
 * @property {Record<string, number>} [coverage] 0 to 1
 * @property {boolean} [enough]
 * @property {boolean} [cover_asked]
 * @property {string | null} [covered] the side whose lens was covered
 *
 * @typedef {object} Calibrating what is being calibrated
 * @property {string | null} source null: images were sent in
 * @property {{kind: string, columns: number, rows: number, square_mm: number, words: string}} board
 * @property {boolean} automatic
 * @property {BoardLook | null} look
 * @property {CapturedView[]} views
 * @property {string[]} refused images that could not be used, one sentence each
 * @property {{words: string, share: number} | null} computing
 * @property {string | null} trouble why the last computation failed
 * @property {string[] | null} result names of the views that the result rests on
 *
 * @typedef {object} RowDrift how far the rows of left and right are apart
 * @property {number | null} now_px
 * @property {number | null} trend_px_per_min
 * @property {string | null} warning
 * @property {[number, number][]} history seconds and pixels
 *
 * @typedef {object} TapeCheck a place whose distance was measured by a tape
 * @property {number} measured_m
 * @property {number} stated_m
 * @property {number} expected_m two standard deviations of the difference
 * @property {boolean} agrees
 * @property {string} sentence
 * @property {string} at ISO 8601
 *
 * @typedef {object} LiveCamera
 * @property {"left" | "right" | "both"} side
 * @property {string} device
 * @property {"open" | "waiting" | "failed"} state
 * @property {string | null} trouble
 * @property {Record<string, string>} settings what it accepted
 * @property {string[]} refused what it did not
 *
 * @typedef {object} Live how a live source is
 * @property {LiveCamera[]} cameras
 * @property {number} pairs
 * @property {number} dropped
 * @property {number | null} skew_median_s
 * @property {number | null} skew_p95_s
 * @property {number} reopened
 * @property {string[]} hints
 * @property {string | null} trouble
 *
 * @typedef {object} LiveTruth motion capture as it comes in
 * @property {string} spec
 * @property {string | null} observer the body that was said to carry the camera
 * @property {string[]} ignore bodies that are not compared
 * @property {"connecting" | "receiving" | "waiting"} state
 * @property {string | null} trouble
 * @property {{name: string, role: string | null, rate_hz: number | null}[]} bodies
 * @property {{offset_s: number, drift_ppm: number | null, sigma_s: number, samples: number} | null} clock
 * @property {boolean} aligned
 * @property {string} sentence why it is not yet, or how
 * @property {Record<string, any> | null} alignment
 *
 * @typedef {object} Recording the run's, which is on
 * @property {"none" | "jpeg" | "lossless"} images
 * @property {number} bytes of the file
 * @property {number} seconds
 * @property {number} dropped messages lost because the disk did not keep up
 * @property {string | null} trouble why nothing is recorded any more
 *
 * @typedef {object} Status
 * @property {{state: string, reason: string | null, pid: number | null, generation: number,
 *   restarts: number, heartbeat_age_s: number | null}} engine
 * @property {SourceInfo | null} source
 * @property {Playback | null} playback
 * @property {{width: number, height: number} | null} camera the rectified pair
 * @property {{id: string, name: string, started_at: string} | null} run
 * @property {{height_m: number, tilt_rad: number, roll_rad: number} | null} mount of the left camera
 * @property {{rows: RowDrift, vergence: {status: string, sentence: string}} | null} ageing
 * @property {Live | null} live
 * @property {Calibrating | null} calibrating
 * @property {{id: string, name: string} | null} calibration
 * @property {number} parameters_revision
 * @property {number} guard_revision
 * @property {{unique_frames_per_s: number | null}} rates
 * @property {{per_s: number, age_s: number | null, median_ms: number | null,
 *   coarseness: number | null}} dense_stereo
 * @property {{median: number | null, p95: number | null, count: number}} latency_ms
 * @property {Record<string, number>} timings_ms
 * @property {EgoMotion | null} ego_motion
 * @property {{frames_skipped: number, observations_lost: number,
 *   live_messages_dropped: number, writes_dropped: number}} drops
 * @property {{index: number, reason: string}[]} skipped
 * @property {number} viewers
 * @property {boolean} has_truth
 * @property {LiveTruth | null} [truth]
 * @property {Recording | null} recording
 * @property {string[]} warnings one sentence each
 * @property {string} version
 *
 * @typedef {object} SourceChoice
 * @property {string} spec
 * @property {string} title
 * @property {string} help
 *
 * @typedef {object} Run
 * @property {string} id
 * @property {string} name
 * @property {"running" | "finished" | "interrupted" | "failed"} state
 * @property {string} source
 * @property {string} started_at ISO 8601
 * @property {string} updated_at ISO 8601, the last sign of life
 * @property {string | null} ended_at ISO 8601
 * @property {number} frames
 * @property {number} segments
 * @property {string | null} reason
 * @property {string | null} preset
 * @property {Record<string, ParameterValue>} parameters at its start
 * @property {string | null} calibration_id
 * @property {Record<string, string>} versions of what computed it
 * @property {"none" | "jpeg" | "lossless" | null} record which images its recording keeps
 * @property {number | null} recording_bytes
 * @property {string[]} tags
 * @property {string} notes
 * @property {string | null} truth_id the truth file it is compared with
 * @property {boolean} aligned
 * @property {string | null} rerun_of the run whose recording was observed again
 * @property {string | null} deleted_at since when it is hidden
 *
 * @typedef {object} Calibration
 * @property {string} id content hash
 * @property {string} name
 * @property {number} width
 * @property {number} height
 * @property {number} baseline_m
 * @property {number} hfov_deg
 * @property {boolean} rectified
 * @property {string} created_at ISO 8601
 * @property {boolean} active
 * @property {string | null} origin where it came from
 * @property {string[]} notes what was decided while its file was understood
 * @property {string[]} devices the cameras it belongs to
 * @property {Record<string, any> | null} report how good it is
 * @property {TapeCheck[]} tape_checks
 *
 * @typedef {"connecting" | "open" | "closed"} Connection
 *
 * @typedef {object} Freshness how old what the page shows is
 * @property {"fresh" | "held" | "stale" | "none"} state held: paused or ended on purpose
 * @property {string} reason one sentence, empty while fresh
 * @property {number} age_s
 */

export {};
