/** The curves of stored runs, prepared for one chart or several. Pure functions. */

import { gapsIn, speedAt } from "../chart/speed-curves.js";
import { GAP_STEPS } from "../elements/facts.js";
import { trackColour } from "../elements/words.js";

/** @import { ChartCurve, RunChart } from "../contract" */

/** @import { Curve } from "../chart/speed-curves.js" */

/** @typedef {"matched" | "band" | "truth" | "commanded" | "encoder" | "stray" | "own"} Choice curves to show or hide */

/**
 * @typedef {Curve & {choice: Choice, words: string, run: string, parts: {begin: number, end: number, label: string}[]}} ChosenCurve
 * words: the track's number. run: its name. parts: successive tracks in one curve
 */

/**
 * @typedef {object} Panel one chart
 * @property {string} title
 * @property {RunChart[]} charts
 * @property {ChosenCurve[]} curves
 * @property {{time: number, speed: number, words: string, colour: string, choice: Choice}[]} starts
 * @property {{time: number, words: string, colour: string, body: string, run: string}[]} changes
 * @property {{time: number, run: string}[]} segments first track of each segment after the first
 * @property {{begin: number, end: number, run: string}[]} gaps in truth
 */

// Tracks with fewer samples are drawn without their number.
const MIN_LABELLED_SAMPLES = 5;
/** @type {Choice[]} front to back */
const ORDER = ["truth", "commanded", "encoder", "matched", "stray", "own"];

/**
 * @param {RunChart[]} charts
 * @param {boolean} overlaid all in one chart, coloured by run; else one chart each, by track
 * @returns {Panel[]}
 */
export function panelsOf(charts, overlaid) {
  const origins = originsOf(charts);
  if (!overlaid) {
    return charts.map((chart, run) => {
      const curves = curvesOf(chart, run, Number(origins[run]), null);
      return {
        title: chart.run.name,
        charts: [chart],
        curves: inOrder(assignLanes(curves)),
        starts: startsOf(curves),
        changes: changesOf(chart, Number(origins[run]), "--muted"),
        segments: segmentsOf(chart, Number(origins[run])),
        gaps: gapsOf(curves),
      };
    });
  }
  // Curves that a run and its re-run share are drawn once.
  const shared = sameRecording(charts);
  const curves = charts.flatMap((chart, run) =>
    curvesOf(chart, run, Number(origins[run]), { colour: trackColour(run), shared }).filter(
      (curve) => !shared || run === 0 || isTrack(curve),
    ),
  );
  return [
    {
      title: charts.map(({ run }) => run.name).join(" and "),
      charts,
      curves: inOrder(assignLanes(curves)),
      starts: [],
      changes: charts.flatMap((chart, run) =>
        changesOf(chart, Number(origins[run]), trackColour(run)),
      ),
      segments: charts.flatMap((chart, run) => segmentsOf(chart, Number(origins[run]))),
      gaps: gapsOf(curves),
    },
  ];
}

/**
 * Return the origin of each chart on its source's clock: zero, unless the runs are from several
 * recordings, whose clocks are unrelated.
 *
 * @param {RunChart[]} charts
 * @returns {number[]}
 */
export function originsOf(charts) {
  if (sameRecording(charts)) return charts.map(() => 0);
  return charts.map((chart) => spanOf(chart)[0]);
}

/** Return whether all are of one recording: a run and its re-runs. @param {RunChart[]} charts */
export function sameRecording(charts) {
  const origin = new Map(charts.map(({ run }) => [run.id, run.rerun_of ?? null]));
  const roots = charts.map(({ run }) => {
    let id = run.id;
    for (let hops = 0; hops < charts.length; hops += 1) id = origin.get(id) ?? id;
    return id;
  });
  return new Set(roots).size <= 1;
}

/** @param {RunChart[]} charts @returns {[number, number]} extent of all runs, s, as drawn */
export function extentOf(charts) {
  const origins = originsOf(charts);
  const spans = charts.map((chart, run) =>
    spanOf(chart).map((time) => time - Number(origins[run])),
  );
  const begin = least(spans.map(([first]) => first)) ?? 0;
  const end = -(least(spans.map((span) => -Number(span[1]))) ?? 0);
  return [begin, end > begin ? end : begin + 1];
}

/**
 * Return a run's first and last time on its clock, taken from its curves if an old version did not
 * store them.
 *
 * @param {RunChart} chart
 * @returns {[number, number]}
 */
function spanOf({ run, curves }) {
  if (run.begin_s !== null && run.duration_s !== null)
    return [run.begin_s, run.begin_s + run.duration_s];
  const begin = least(curves.map(({ times }) => times[0])) ?? 0;
  return [begin, -(least(curves.map(({ times }) => -Number(times.at(-1)))) ?? -begin)];
}

/**
 * Return each curve's value at a time, in the order of the curves.
 *
 * @param {ChosenCurve[]} curves
 * @param {number} time
 * @param {number} reach seconds
 */
export function readingsAt(curves, time, reach) {
  return curves.flatMap((curve) => {
    const measured = speedAt(curve, time, reach);
    if (!measured) return [];
    const part = curve.parts.find(({ begin, end }) => time >= begin - reach && time <= end + reach);
    return [
      { ...measured, label: part?.label ?? curve.label, colour: curve.colour, kind: curve.kind },
    ];
  });
}

/** @param {string | number} track as in "0:3" @returns {string} without its segment */
export function trackInWords(track) {
  return String(track).split(":").at(-1) ?? "";
}

/**
 * @param {RunChart} chart
 * @param {number} run its index
 * @param {number} origin
 * @param {{colour: string, shared: boolean} | null} overlay colour of this run; shared: all are of one recording
 * @returns {ChosenCurve[]}
 */
function curvesOf(chart, run, origin, overlay) {
  const known = chart.curves.some(
    ({ kind, body }) => kind === "estimate" && body !== null && body !== "",
  );
  return chart.curves
    .filter(({ times }) => times.length > 0)
    .map((stored, at) => {
      const choice = choiceOf(stored, known);
      const kind = choice === "stray" ? "stray" : stored.kind;
      // Name the run, so that colour is not the only distinction.
      const own = overlay && (stored.kind === "estimate" || !overlay.shared);
      const label = own ? `${chart.run.name}: ${labelOf(stored)}` : labelOf(stored);
      const broken = withGaps(stored);
      const times = broken.times.map((time) => time - origin);
      /** @type {ChosenCurve} */
      const curve = {
        key: `${run}/${at}`,
        kind,
        label,
        colour: overlay && stored.kind === "estimate" ? overlay.colour : colourOf(stored, choice),
        banded: choice === "matched",
        times,
        speeds: broken.speeds,
        stds: broken.stds,
        choice,
        words: String(stored.track_id ?? ""),
        run: chart.run.name,
        parts: [{ begin: Number(times[0]), end: Number(times.at(-1)), label }],
      };
      return curve;
    });
}

/** @param {ChartCurve} curve @param {boolean} known whether any track has a body @returns {Choice} */
function choiceOf({ kind, role, body }, known) {
  if (kind === "estimate") return known && !body ? "stray" : "matched";
  return role === "observer" ? "own" : kind;
}

/** Name a curve as the live chart does. @param {ChartCurve} curve */
function labelOf({ kind, label, track_id }) {
  if (kind === "estimate") return track_id === null ? label : `Obstacle ${track_id}`;
  return kind === "truth" ? `Ground truth ${label}` : label;
}

/** @param {ChartCurve} curve @param {Choice} choice */
function colourOf({ kind, track_id }, choice) {
  if (choice === "matched") return trackColour(track_id ?? 0);
  if (choice === "own") return "--accent";
  if (kind === "truth") return "--text";
  return kind === "encoder" ? "--warn" : "--muted";
}

/**
 * Join successive tracks of one colour into one curve: a long run has hundreds of them.
 *
 * @param {ChosenCurve[]} curves
 * @returns {ChosenCurve[]}
 */
function assignLanes(curves) {
  /** @type {Map<string, ChosenCurve[]>} */
  const lanes = new Map();
  const tracks = curves.filter(isTrack).sort((a, b) => Number(a.times[0]) - Number(b.times[0]));
  for (const track of tracks) {
    const group = `${track.choice} ${track.colour}`;
    const own = lanes.get(group) ?? [];
    lanes.set(group, own);
    const begin = Number(track.times[0]);
    const lane = own.find(({ times }) => Number(times.at(-1)) < begin);
    if (!lane) {
      own.push({ ...track });
      continue;
    }
    const between = (Number(lane.times.at(-1)) + begin) / 2;
    lane.times = [...lane.times, between, ...track.times];
    lane.speeds = [...lane.speeds, null, ...track.speeds];
    lane.stds = [...lane.stds, null, ...track.stds];
    lane.parts = [...lane.parts, ...track.parts];
  }
  return [...[...lanes.values()].flat(), ...curves.filter((curve) => !isTrack(curve))];
}

/** @param {ChosenCurve} curve */
function isTrack({ choice }) {
  return choice === "matched" || choice === "stray";
}

/**
 * Put a null into every gap that is too long, so that no line is drawn across it.
 *
 * @param {ChartCurve} curve
 */
function withGaps({ times, speeds, stds }) {
  const steps = times.slice(1).map((time, i) => time - Number(times[i]));
  const usual = [...steps].sort((a, b) => a - b)[steps.length >> 1] ?? 0;
  const longest = steps.length < 2 ? Infinity : GAP_STEPS * usual;
  /** @type {{times: number[], speeds: (number | null)[], stds: (number | null)[]}} */
  const found = { times: [], speeds: [], stds: [] };
  times.forEach((time, i) => {
    const before = times[i - 1];
    if (before !== undefined && time <= before) return;
    if (before !== undefined && time - before > longest) {
      found.times.push((before + time) / 2);
      found.speeds.push(null);
      found.stds.push(null);
    }
    found.times.push(time);
    found.speeds.push(speeds[i] ?? null);
    found.stds.push(stds?.[i] ?? null);
  });
  return found;
}

/** Return where tracks begin, to show identity switches. @param {ChosenCurve[]} curves not yet joined */
function startsOf(curves) {
  return curves
    .filter((curve) => isTrack(curve) && curve.times.length >= MIN_LABELLED_SAMPLES)
    .flatMap(({ times, speeds, colour, choice, words }) => {
      const first = speeds.findIndex((speed) => speed !== null);
      const speed = speeds[first];
      return typeof speed === "number"
        ? [{ time: Number(times[first]), speed, words, colour, choice }]
        : [];
    })
    .sort((a, b) => a.time - b.time);
}

/** @param {RunChart} chart @param {number} origin @param {string} colour */
function changesOf({ run, changes }, origin, colour) {
  return changes.map(({ time, body, before, after }) => ({
    time: time - origin,
    words: `${trackInWords(before)} → ${trackInWords(after)}`,
    colour,
    body,
    run: run.name,
  }));
}

/** Return where tracks begin anew, as after a rewind. @param {RunChart} chart @param {number} origin */
function segmentsOf({ run, curves }, origin) {
  /** @type {Map<number, number>} */
  const begins = new Map();
  for (const { segment, times } of curves) {
    const [time] = times;
    if (segment === null || time === undefined) continue;
    begins.set(segment, Math.min(time, begins.get(segment) ?? Infinity));
  }
  const [, ...later] = [...begins.values()].sort((a, b) => a - b);
  return later.map((time) => ({ time: time - origin, run: run.name }));
}

/** @param {ChosenCurve[]} curves */
function gapsOf(curves) {
  return curves
    .filter(({ choice }) => choice === "truth")
    .flatMap((curve) => gapsIn(curve).map((gap) => ({ ...gap, run: curve.run })));
}

/** @param {ChosenCurve[]} curves the last is drawn on top */
function inOrder(curves) {
  return [...curves].sort((a, b) => ORDER.indexOf(b.choice) - ORDER.indexOf(a.choice));
}

/** @param {(number | undefined)[]} values */
function least(values) {
  return values.reduce(
    (best, value) => (value !== undefined && (best === undefined || value < best) ? value : best),
    undefined,
  );
}
