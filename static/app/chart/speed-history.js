/** The last minute of speeds as curves, and where identities change. No drawing here. */

import { trackColour } from "../elements/words.js";

/** @import { ObservationMessage, TrueBodyEntry, WheelSpeed } from "../contract" */

/** @import { Curve, Kind } from "./speed-curves.js" */

// If nothing arrives for longer than this, the curves have a gap.
const JUMP_S = 1;
// Gap between the end of one playback and the start of the next.
const GAP_S = 0.5;
// A curve breaks right after its last sample: the next one may be older than the newest frame.
const GAP_AFTER_S = 1e-4;
// The shown window grows in these steps, so that the scale of time seldom changes.
const WINDOWS_S = [10, 20, 30];
// Times relative to the newest observation are exact to this.
const ROUNDING_S = 1e-6;
// Curves are trimmed in batches of this many samples: shifting a long array costs more than
// keeping a few extra samples.
const TRIM_BATCH = 50;
const ROBOT_COLOURS = { observer: "--accent", obstacle: "--warn" };

export class SpeedHistory {
  /** Seconds of the newest observation; keeps rising when the source is restarted. */
  newest = 0;
  /** @type {Map<string, Curve>} */
  curves = new Map();
  /** Identity switches: another track took a body's place. @type {{time: number, words: string, colour: string}[]} */
  changes = [];
  /** First measurement of each track. @type {{time: number, speed: number, words: string, colour: string}[]} */
  starts = [];

  /** Where no observation arrived at all, so nothing is known of any curve. @type {{begin: number, end: number}[]} */
  #silences = [];
  #began = false;
  #late = 0;
  /** Seconds of the first observation. */
  #first = 0;
  #playedFrom = 0;
  #offset = 0;
  #epoch = 0;
  #lastTime = 0;
  #lastSegment = 0;
  #lastSequence = -1;
  /** The track last assigned to each body. @type {Map<number, number>} */
  #identity = new Map();

  /**
   * @param {number} span_s seconds of history to keep
   * @param {number} late number of first observations that are forgotten if the source starts over:
   *   they were of the previous source
   */
  constructor(span_s, late = 0) {
    this.span_s = span_s;
    this.#late = late;
  }

  /**
   * The stored range of the current playback, in the curves' seconds; offset: how far these are
   * ahead of the source's clock.
   */
  get playing() {
    return {
      begin: Math.max(this.newest - this.span_s, this.#playedFrom),
      end: this.newest,
      offset: this.#offset,
    };
  }

  /** Seconds to show: the shortest window with everything that is stored. */
  get window_s() {
    const stored = this.newest - this.#first;
    return WINDOWS_S.find((each) => each >= stored && each < this.span_s) ?? this.span_s;
  }

  /**
   * Whether no observation arrived during a gap of a curve: then it says nothing about the curve.
   *
   * @param {number} begin
   * @param {number} end
   */
  isSilent(begin, end) {
    return this.#silences.some(
      (silence) => begin > silence.begin - ROUNDING_S && end < silence.end + ROUNDING_S,
    );
  }

  /** @param {ObservationMessage} message */
  add({ sequence, line, truth }) {
    this.#continue(line.time, line.segment, sequence);
    const now = this.newest;
    /** @type {Set<string>} */
    const updated = new Set();
    for (const obstacle of line.obstacles) {
      // While a track coasts nothing is measured: show a gap, not a prediction.
      if (obstacle.state === "coasting") continue;
      const key = `${this.#epoch}/${line.segment}/${obstacle.id}`;
      const colour = trackColour(obstacle.id);
      // A speed is valid at the middle of its displacement; the frame's time would be too late.
      const time = Math.min(now, obstacle.velocity_time + this.#offset);
      if (!this.curves.has(key))
        this.starts.push({ time, speed: obstacle.speed, words: String(obstacle.id), colour });
      const curve = this.#curve(key, "estimate", `Obstacle ${obstacle.id}`, colour);
      addSample(curve, time, obstacle.speed, obstacle.speed_std);
      updated.add(key);
    }
    for (const body of truth) {
      this.#identify(body, now);
      if (body.role === "observer") continue;
      const truth = this.#curve(`truth/${body.id}`, "truth", `Ground truth ${body.name}`, "--text");
      addSample(truth, now, body.speed);
      updated.add(truth.key);
      const { commanded_speed: ordered } = body;
      if (ordered === null || ordered === undefined) continue;
      const commanded = this.#curve(
        `commanded/${body.id}`,
        "commanded",
        `Commanded ${body.name}`,
        "--muted",
      );
      addSample(commanded, now, Math.abs(ordered));
      updated.add(commanded.key);
    }
    for (const [key, curve] of this.curves) {
      if (!updated.has(key) && !isRobotCurve(curve)) startGap(curve);
    }
    this.#trim();
  }

  /**
   * Add robots' commanded and wheel speeds; magnitudes only, as for obstacles.
   *
   * @param {WheelSpeed[]} samples since the last time
   */
  addWheels(samples) {
    if (!this.#began) return;
    for (const { role, time, sent_mps, encoder_mps } of samples) {
      const at = time + this.#offset;
      // From another source's clock, or from before a restart.
      if (Math.abs(at - this.newest) > JUMP_S) continue;
      const colour = ROBOT_COLOURS[role];
      addSample(
        this.#curve(`sent/${role}`, "sent", `Sent to ${role}`, colour),
        at,
        Math.abs(sent_mps),
      );
      if (encoder_mps === null) continue;
      const wheels = this.#curve(`encoder/${role}`, "encoder", `Wheel encoders of ${role}`, colour);
      addSample(wheels, at, Math.abs(encoder_mps));
    }
  }

  /**
   * @param {number} time
   * @param {number} segment
   * @param {number} sequence
   */
  #continue(time, segment, sequence) {
    const ahead = time - this.#lastTime;
    const restarted = segment !== this.#lastSegment || sequence <= this.#lastSequence || ahead <= 0;
    if (restarted && this.#late > 0) this.#forget();
    this.#late -= 1;
    const before = this.newest;
    if (!this.#began) {
      this.#playedFrom = this.#first = time;
    } else if (restarted) {
      for (const curve of this.curves.values()) startGap(curve);
      this.#identity.clear();
      this.#epoch += 1;
      this.#offset = this.newest + GAP_S - time;
      this.#playedFrom = this.newest + GAP_S;
    }
    const silent = this.#began && (restarted || ahead > JUMP_S);
    this.#began = true;
    this.newest = time + this.#offset;
    if (silent) this.#silences.push({ begin: before, end: this.newest });
    this.#lastTime = time;
    this.#lastSegment = segment;
    this.#lastSequence = sequence;
  }

  #forget() {
    this.#began = false;
    this.#offset = 0;
    this.curves.clear();
    this.changes = [];
    this.starts = [];
    this.#silences = [];
    this.#identity.clear();
  }

  /**
   * @param {TrueBodyEntry} body
   * @param {number} now
   */
  #identify({ id, track_id }, now) {
    if (track_id === null) return;
    const before = this.#identity.get(id);
    if (before !== undefined && before !== track_id) {
      this.changes.push({ time: now, words: `${before} → ${track_id}`, colour: "--muted" });
    }
    this.#identity.set(id, track_id);
  }

  /**
   * Return a curve, created if missing.
   *
   * @param {string} key
   * @param {Kind} kind
   * @param {string} label
   * @param {string} colour
   */
  #curve(key, kind, label, colour) {
    const banded = kind === "estimate";
    /** @type {Curve} */
    const made = { key, kind, label, colour, banded, times: [], speeds: [], stds: [] };
    const curve = this.curves.get(key) ?? made;
    this.curves.set(key, curve);
    return curve;
  }

  #trim() {
    const oldest = this.newest - this.span_s;
    for (const [key, curve] of this.curves) {
      const last = curve.times.at(-1);
      if (last === undefined || last < oldest) {
        this.curves.delete(key);
      } else if (Number(curve.times[TRIM_BATCH]) < oldest) {
        for (const list of [curve.times, curve.speeds, curve.stds]) list.splice(0, TRIM_BATCH);
      }
    }
    while (this.#silences[0] && this.#silences[0].end < oldest) this.#silences.shift();
    while (this.changes[0] && this.changes[0].time < oldest) this.changes.shift();
    while (this.starts[0] && this.starts[0].time < oldest) this.starts.shift();
  }
}

/** Whether it is a robot's curve, whose samples arrive separately. @param {Curve} curve */
function isRobotCurve({ kind }) {
  return kind === "sent" || kind === "encoder";
}

/** Start a gap, as nothing was measured: from the last sample to the next. @param {Curve} curve */
function startGap(curve) {
  const last = curve.times.at(-1);
  if (last !== undefined && curve.speeds.at(-1) !== null)
    append(curve, last + GAP_AFTER_S, null, null);
}

/**
 * Extend a curve, after a gap if nothing arrived for too long.
 *
 * @param {Curve} curve
 * @param {number} time
 * @param {number} speed
 * @param {number | null} [std]
 */
function addSample(curve, time, speed, std = null) {
  const last = curve.times.at(-1);
  if (last !== undefined) {
    if (time <= last) return;
    if (time - last > JUMP_S) append(curve, (last + time) / 2, null, null);
  }
  append(curve, time, speed, std);
}

/** @param {Curve} curve @param {number} time @param {number | null} speed @param {number | null} std */
function append(curve, time, speed, std) {
  curve.times.push(time);
  curve.speeds.push(speed);
  curve.stds.push(std);
}
