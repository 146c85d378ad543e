/** Fake server messages: each function returns a complete message with a test's changes. */

/** @import { AgeingStatus, GoalNow, LiveLine, ObstacleEntry, RobotNow, RobotReport, RobotsMessage, Run, TrueBodyEntry } from "../../static/app/contract" */
/** @import { ParameterEntry } from "../../static/app/parameters/parameter-store.js" */

/** It moves, 3 m ahead. @param {Partial<ObstacleEntry>} [changes] @returns {ObstacleEntry} */
export function obstacle(changes) {
  return {
    id: 1,
    state: "confirmed",
    motion: "moving",
    position: [0, 0, 3],
    velocity: [0.5, 0, 0],
    speed: 0.5,
    speed_std: 0.02,
    velocity_time: 0,
    range: 3,
    bearing: 0,
    closing_speed: 0,
    points: 20,
    significance: 12,
    size: [0.4, 0.5, 0.4],
    position_cov: null,
    velocity_cov: null,
    orientation_wxyz: null,
    box_px: [0, 0, 1, 1],
    why: "",
    ...changes,
  };
}

/** @param {Partial<TrueBodyEntry>} [changes] @returns {TrueBodyEntry} */
export function body(changes) {
  return {
    id: 7,
    name: "cart",
    role: "obstacle",
    position: [0, 0, 3],
    velocity: [0.5, 0, 0],
    speed: 0.5,
    size: [0.4, 0.5, 0.4],
    yaw: 0,
    visible: 1,
    commanded_speed: null,
    track_id: null,
    ...changes,
  };
}

/** @param {Partial<LiveLine>} [changes] @returns {LiveLine} */
export function line(changes) {
  return {
    frame: 0,
    time: 0,
    segment: 0,
    status: "ok",
    reasons: [],
    parameters_revision: 1,
    pose: { position: [0, 0, 0], orientation_wxyz: [1, 0, 0, 0] },
    obstacles: [],
    unseen: null,
    timings_ms: {},
    ...changes,
  };
}

/** @param {Partial<Run>} [changes] @returns {Run} */
export function run(changes) {
  return {
    id: "r1",
    name: "first",
    state: "finished",
    source: "simulated:lab",
    source_name: "simulated:lab",
    started_at: "2026-01-01T10:00:00Z",
    updated_at: "2026-01-01T10:01:00Z",
    ended_at: "2026-01-01T10:01:12Z",
    begin_s: null,
    duration_s: 70.5,
    frames: 100,
    segments: 1,
    reason: null,
    preset: null,
    parameters: {},
    calibration_id: null,
    versions: {},
    record: "jpeg",
    recording_bytes: null,
    tags: [],
    notes: "",
    truth_id: null,
    aligned: false,
    rerun_of: null,
    deleted_at: null,
    ...changes,
  };
}

/** @param {Partial<RobotReport>} [changes] @returns {RobotReport} */
export function report(changes) {
  return {
    phase: "connected",
    trouble: null,
    fault: null,
    warnings: [],
    received: 10,
    name: null,
    model: null,
    subtype: null,
    odometry: null,
    sent: null,
    wanted: null,
    speed_mps: null,
    turn_rate_radps: null,
    motors_enabled: null,
    stalled: null,
    front_bumpers: [],
    rear_bumpers: [],
    stop_pressed: null,
    battery_v: null,
    battery: null,
    charging: null,
    temperature_c: null,
    sonars: [],
    watchdog_s: null,
    limits: null,
    radius_m: null,
    width_m: null,
    length_m: null,
    counters: {},
    ...changes,
  };
}

/** Connected, with its motors off. @param {Partial<RobotNow>} [changes] @returns {RobotNow} */
export function robot(changes) {
  return {
    port: "/dev/ttyUSB0",
    name: null,
    world: "real",
    state: "disarmed",
    operator: null,
    present: false,
    why: null,
    commanded: { speed_mps: 0, turn_rate_radps: 0 },
    sent: { speed_mps: 0, turn_rate_radps: 0 },
    guard: null,
    report: report(),
    ...changes,
  };
}

/** No robot is connected. @param {Partial<RobotsMessage>} [changes] @returns {RobotsMessage} */
export function robots(changes) {
  return {
    type: "robots",
    stopped: null,
    sight: null,
    loop: null,
    programme: null,
    goal: null,
    robots: { observer: null, obstacle: null },
    process: { alive: true, pid: 1, restarts: 0, trouble: null },
    world: "real",
    ports: {},
    trouble: {},
    incidents: [],
    check: null,
    wheels: [],
    ...changes,
  };
}

/** A goal that is being driven to. @param {Partial<GoalNow>} [changes] @returns {GoalNow} */
export function goal(changes) {
  return {
    state: "driving",
    sentence: "Driving to the goal.",
    place: [2, 0],
    distance_m: 2,
    elapsed_s: 3,
    path: [
      [0, 0],
      [0.5, 0],
    ],
    risk_per_metre: 0.001,
    planned_risk_per_metre: 0.0002,
    waits_for: null,
    meets_s: null,
    meets_at: null,
    refused: [],
    ...changes,
  };
}

/** A calibration in good order. @param {Partial<AgeingStatus>} [changes] @returns {AgeingStatus} */
export function ageing(changes) {
  return {
    rows: {
      now_px: 0.1,
      median_px: 0.1,
      roll_rad: 0,
      since_s: null,
      trend_px_per_min: null,
      warning: null,
      history: [],
    },
    vergence: {
      status: "consistent",
      vergence_rad: 0,
      std_rad: 0.0002,
      sentence: "vergence agrees with the wheels",
      distance_m: 3,
    },
    exposure_skew: null,
    ...changes,
  };
}

/** A whole number with limits. @param {Partial<ParameterEntry>} [changes] @returns {ParameterEntry} */
export function parameter(changes) {
  return {
    name: "flow.window_px",
    group: "flow",
    group_help: "Flow.",
    title: "Flow window size",
    help: "Side of the window.",
    type: "integer",
    unit: "px",
    default: 15,
    models: ["affine"],
    cloud: false,
    basic: false,
    minimum: 5,
    maximum: 51,
    step: 2,
    choices: null,
    labels: null,
    ...changes,
  };
}
