/** The page's state of the server, and the events that notify its parts of changes. */

import { STALE_AFTER_S } from "../elements/facts.js";
import { sentence } from "../elements/words.js";
import { FloorPick } from "./floor-pick.js";
import { LiveSocket } from "./live-socket.js";
import { Emitter } from "./emitter.js";

/** @import { LogEntry, ObservationMessage, RobotsMessage, SourceEntry, Status } from "../contract" */
/** @import { Driver } from "../driving/driver.js" */
/** @import { Connection } from "./live-socket.js" */

/**
 * @typedef {object} Freshness age of the data shown
 * @property {"fresh" | "held" | "stale" | "none"} state held: paused or ended on purpose
 * @property {string} reason one sentence, empty while fresh
 * @property {number} age_s
 */

// A restarted server is back sooner, unless its port or address has changed.
const RESTART_HINT_AFTER_S = 15;
const FRESHNESS_CHECK_MS = 200;

/**
 * Events, all without detail (read the property of the same name):
 * `status`, `observation` (inside an animation frame), `painted` (right after that frame),
 * `connection`, `freshness`, `reconnected` (the socket is back after a loss), `runs`,
 * `calibrations`, `parameters` (that list has changed: read it again), `calibrate` (the user wants
 * to calibrate), `sources` (the choice of sources has changed), `page` (one has replaced the live
 * parts or given way to them), `titled` (the page that replaced them has another heading),
 * `robots` (state of robots and driving), `log` (entries were added).
 */
export class Hub extends Emitter {
  /** @type {Status | null} */
  status = null;
  /** @type {ObservationMessage | null} */
  observation = null;
  /** State of robots and driving; null until the first message. @type {RobotsMessage | null} */
  robots = null;
  /** The entries added to the log last. @type {LogEntry[]} */
  log = [];
  /** A source that could not be opened because it has no calibration. */
  uncalibrated = "";
  /** The sources to choose from. @type {SourceEntry[]} */
  sources = [];
  /** @type {Connection} */
  connection = "connecting";
  /** When the newest message of the live socket was read, ms of `performance.now`. */
  heardAt = -Infinity;
  /** A click on the floor of the 3D scene, which a part may request. */
  floorPick = new FloorPick();
  /** @type {Freshness} */
  freshness = { state: "none", reason: "Connecting to the server.", age_s: 0 };

  #lost = false;
  #wasOutdated = false;
  #frameAsked = false;
  /** @type {number[]} */
  #unpainted = [];
  /** @type {{at: number, age_s: number | null} | null} */
  #heartbeat = null;
  // A message to it is handled right after the frame is painted, unlike requestAnimationFrame.
  #afterPaint = new MessageChannel();

  /** @param {(hub: Hub) => Driver} driver creates this page's driver of the robots */
  constructor(driver) {
    super();
    this.socket = new LiveSocket(() => "/api/live", {
      message: (message) => this.#receive(message),
      state: (state) => this.#connectionChanged(state),
    });
    this.driver = driver(this);
    this.#afterPaint.port1.onmessage = () => this.#acknowledge();
    let checkedAt = performance.now();
    setInterval(() => {
      const late = performance.now() - checkedAt > 2 * FRESHNESS_CHECK_MS;
      checkedAt = performance.now();
      // If the page itself was held up, first read the messages that arrived meanwhile.
      if (late) setTimeout(() => this.#updateFreshness(), FRESHNESS_CHECK_MS / 2);
      else this.#updateFreshness();
    }, FRESHNESS_CHECK_MS);
  }

  start() {
    this.socket.open();
  }

  /** Whether the robots may since have done something else than `robots` says. */
  get robotsOutdated() {
    return areRobotsOutdated(this.connection, this.robots, this.heardAt, performance.now());
  }

  /** @param {Status} status from the socket or from the answer to a request that changed it */
  applyStatus(status) {
    this.status = status;
    this.emit("status");
    this.#updateFreshness();
  }

  /** @param {any} message */
  #receive(message) {
    this.heardAt = performance.now();
    if (message.type === "observation") {
      this.#heartbeat = { at: performance.now(), age_s: message.age_ms / 1000 };
      this.observation = message;
      this.#unpainted.push(message.sequence);
      this.#askForFrame();
    } else if (message.type === "heartbeat") {
      this.#heartbeat = { at: performance.now(), age_s: message.observation_age_s };
    } else if (message.type === "status") {
      this.applyStatus(message);
    } else if (message.type === "robots") {
      this.robots = message;
      this.emit("robots");
    } else if (message.type === "log") {
      this.log = message.entries;
      this.emit("log");
    }
    // Only once the server sends something: one that accepts and hangs up is not back yet.
    if (this.#lost) {
      this.#lost = false;
      this.emit("reconnected");
    }
  }

  #askForFrame() {
    if (this.#frameAsked) return;
    this.#frameAsked = true;
    requestAnimationFrame(() => {
      this.#frameAsked = false;
      this.emit("observation");
      this.#updateFreshness();
      this.#afterPaint.port2.postMessage(null);
    });
  }

  #acknowledge() {
    for (const sequence of this.#unpainted.splice(0)) {
      this.socket.send({ type: "painted", sequence });
    }
    this.emit("painted");
  }

  /** @param {Connection} state */
  #connectionChanged(state) {
    this.connection = state;
    this.#unpainted = [];
    this.emit("connection");
    this.#lost ||= state === "closed";
    this.#updateFreshness();
  }

  #updateFreshness() {
    const before = this.freshness;
    this.freshness = assessFreshness(
      this.connection,
      this.status,
      this.#heartbeat,
      performance.now(),
    );
    const outdated = this.robotsOutdated;
    const changed =
      before.state !== this.freshness.state ||
      before.reason !== this.freshness.reason ||
      outdated !== this.#wasOutdated;
    this.#wasOutdated = outdated;
    if (changed) this.emit("freshness");
  }
}

/**
 * Judge whether robots may since have done something else than the newest message says.
 *
 * @param {Connection} connection
 * @param {RobotsMessage | null} robots the newest message
 * @param {number} heardAt when anything was received last, ms of `now`'s clock
 * @param {number} now ms
 */
export function areRobotsOutdated(connection, robots, heardAt, now) {
  const isSilent = now - heardAt > 1000 * STALE_AFTER_S;
  return connection !== "open" || isSilent || robots?.process?.alive === false;
}

/**
 * Judge how old the shown data is, and why.
 *
 * @param {Connection} connection
 * @param {Status | null} status
 * @param {{at: number, age_s: number | null} | null} heartbeat the last report of the age of the newest
 *   observation, and when it arrived (ms of `now`'s clock)
 * @param {number} now ms
 * @returns {Freshness}
 */
export function assessFreshness(connection, status, heartbeat, now) {
  const silent_s = heartbeat ? (now - heartbeat.at) / 1000 : 0;
  const age_s = heartbeat && heartbeat.age_s !== null ? heartbeat.age_s + silent_s : 0;
  if (connection !== "open") {
    if (!status) return { state: "none", age_s, reason: "Connecting to the server." };
    const hint =
      silent_s > RESTART_HINT_AFTER_S
        ? " If it was restarted, open the link that it printed then."
        : "";
    return { state: "stale", age_s, reason: `Connection to the server lost. Reconnecting.${hint}` };
  }
  if (!status) return { state: "none", age_s, reason: "Connecting to the server." };
  if (silent_s > STALE_AFTER_S) {
    return { state: "stale", age_s, reason: "The server is not responding. Waiting for it." };
  }
  const { engine, playback } = status;
  if (!["idle", "preview", "running", "calibrating"].includes(engine.state)) {
    return { state: "stale", age_s, reason: sentence(engine.reason ?? "the engine has failed") };
  }
  if (!status.source) {
    return { state: "none", age_s, reason: sentence(engine.reason ?? "No source is open") };
  }
  if (engine.state === "calibrating")
    return { state: "none", age_s, reason: "Calibration in progress." };
  const trouble = status.live?.trouble;
  if (trouble) return { state: "stale", age_s, reason: sentence(trouble) };
  const seen = heartbeat !== null && heartbeat.age_s !== null;
  if (seen && age_s <= STALE_AFTER_S) return { state: "fresh", age_s, reason: "" };
  if (playback?.ended) return { state: "held", age_s, reason: "The source has ended." };
  if (playback?.paused)
    return {
      state: "held",
      age_s,
      reason: playback.frame === null ? "Paused." : `Paused at frame ${playback.frame}.`,
    };
  if (!seen) return { state: "none", age_s, reason: "Waiting for the first frame." };
  return { state: "stale", age_s, reason: "No new frames are arriving." };
}
