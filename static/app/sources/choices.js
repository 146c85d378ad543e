/**
 * Sources to choose from: those listed by the server, cameras it found, stored runs. Pure
 * functions.
 */

import { duration, when } from "../elements/words.js";
import { facts, hasImages } from "../runs/run-words.js";

/** @import { BoardFacts, Run, SourceEntry, VideoDevice } from "../contract" */

/**
 * @typedef {object} Choice
 * @property {string} spec text that opens it
 * @property {string} title
 * @property {string} line what it is, in a few words
 * @property {string} help everything known about it
 * @property {SourceEntry["group"]} group
 * @property {boolean} template its words in capitals are placeholders to be replaced
 * @property {string | null} picture its address
 * @property {number | null} recent rank among those opened recently
 */

const PLACEHOLDER = /\b[A-Z]{4,}\b/g;
const NOT_RECENT = Number.MAX_SAFE_INTEGER;
const RECORDING = /\/runs\/([0-9A-Za-z][\w-]*)\/recording\.mcap$/;

/** @param {SourceEntry} entry @returns {Choice} */
export function choiceOfEntry({ spec, title, help, group, template, picture, board, recent }) {
  const address = picture ? `/api/sources/picture.jpg?${new URLSearchParams({ spec })}` : null;
  const line = board ? "Practise calibrating: opens the wizard with this board filled in." : help;
  return { spec, title, line, help, group, template, picture: address, recent };
}

/** @param {Run[]} runs @returns {Choice[]} those that can be played */
export function choicesOfRuns(runs) {
  return runs
    .filter((run) => hasImages(run) && run.frames > 0)
    .map((run) => ({
      spec: `run:${run.id}`,
      title: run.name,
      line: [run.duration_s === null ? null : duration(run.duration_s), when(run.started_at)]
        .filter(Boolean)
        .join(" · "),
      help: facts(run),
      group: "recordings",
      template: false,
      picture: `/api/runs/${encodeURIComponent(run.id)}/frames/0.jpg`,
      recent: null,
    }));
}

/** @param {VideoDevice[]} cameras that can be used @returns {Choice[]} the first two as a pair */
export function choicesOfCameras([left, right]) {
  if (!left || !right) return [];
  const paths = `${left.path} and ${right.path}`;
  return [
    {
      spec: cameraSpec(nameOf(left), nameOf(right), defaultMode(left)),
      title: [...new Set([left.card ?? "Camera", right.card ?? "Camera"])].join(" and "),
      line: `Two cameras: ${paths}`,
      help: `Opens ${left.path} as the left and ${right.path} as the right camera.`,
      group: "cameras",
      template: false,
      picture: null,
      recent: null,
    },
  ];
}

/**
 * Remove duplicates: the first of each stays, with the recent rank that any of them has.
 *
 * @param {Choice[]} choices
 * @returns {Choice[]}
 */
export function merged(choices) {
  /** @type {Map<string, Choice>} */
  const bySpec = new Map();
  for (const choice of choices) {
    const kept = bySpec.get(choice.spec);
    bySpec.set(choice.spec, kept ? { ...kept, recent: kept.recent ?? choice.recent } : choice);
  }
  return [...bySpec.values()];
}

/**
 * Return the first few, always including the open one.
 *
 * @param {Choice[]} choices
 * @param {number} few
 * @param {string} open the spec of the open source
 * @returns {Choice[]}
 */
export function firstFew(choices, few, open) {
  const first = choices.slice(0, few);
  const current = choices.slice(few).find(({ spec }) => spec === open);
  return current ? [...first.slice(0, few - 1), current] : first;
}

/**
 * Return suggestions for a typed text: recently opened ones first, then by how well they match.
 *
 * @param {Choice[]} choices
 * @param {string} typed each suggestion contains all its words; empty: everything matches
 * @param {number} most of each group, so that no group crowds out another
 * @returns {Choice[]}
 */
export function suggestions(choices, typed, most) {
  /** @type {Map<string, number>} */
  const counts = new Map();
  const words = typed.toLowerCase().split(/\s+/).filter(Boolean);
  const scored = choices.map((choice) => ({ choice, score: score(choice, words) }));
  return scored
    .filter(({ score }) => score < Infinity)
    .sort(
      (a, b) =>
        (a.choice.recent ?? NOT_RECENT) - (b.choice.recent ?? NOT_RECENT) || a.score - b.score,
    )
    .map(({ choice }) => choice)
    .filter(({ group }) => {
      const count = (counts.get(group) ?? 0) + 1;
      counts.set(group, count);
      return count <= most;
    });
}

/** @param {Choice} choice @param {string[]} words */
function score({ title, spec, help }, words) {
  const named = `${title} ${spec}`.toLowerCase();
  if (words.every((word) => named.includes(word))) return 0;
  const text = `${named} ${help}`.toLowerCase();
  return words.every((word) => text.includes(word)) ? 1 : Infinity;
}

/**
 * @param {string} spec a template
 * @returns {[number, number]} begin and end of the part to replace
 */
export function placeholders(spec) {
  const found = [...spec.matchAll(PLACEHOLDER)];
  const last = found.at(-1);
  return last ? [found[0]?.index ?? 0, last.index + last[0].length] : [0, spec.length];
}

/**
 * Return the shortest spec of a source: a run's recording by the run, not by its path.
 *
 * @param {string} spec
 */
export function shortSpec(spec) {
  const run = RECORDING.exec(spec)?.[1];
  return run ? `run:${run}` : spec;
}

/**
 * Return the board that a simulated person shows to a source's cameras.
 *
 * @param {SourceEntry[]} entries
 * @param {string} spec with or without a seed
 * @returns {BoardFacts | null}
 */
export function boardOf(entries, spec) {
  const scenario = spec.trim().split("?")[0];
  return entries.find((entry) => entry.spec === scenario)?.board ?? null;
}

/** @param {VideoDevice} camera @returns {string} a name that survives replugging, if any */
export function nameOf(camera) {
  return camera.by_path ?? camera.path;
}

/** @param {VideoDevice | undefined} camera @returns {[string, string][]} query and words of each mode */
export function modesOf(camera) {
  return (camera?.modes ?? []).map(({ pixel_format, width, height, rates }) => {
    const rate = rates[0];
    const value = new URLSearchParams({
      size: `${width}x${height}`,
      format: pixel_format,
      ...(rate ? { rate: String(rate) } : {}),
    });
    const words = `${width} × ${height}, ${pixel_format}${rate ? `, ${rate} fps` : ""}`;
    return [value.toString(), words];
  });
}

/**
 * Return the mode for compressed images of the usual size, which two cameras on one port can carry.
 *
 * @param {VideoDevice | undefined} camera
 * @returns {string} its query, empty if the camera has no such mode
 */
export function defaultMode(camera) {
  return modesOf(camera).find(([, words]) => words.startsWith("640 × 480, MJPG"))?.[0] ?? "";
}

/**
 * @param {string} left
 * @param {string} right empty if the left one delivers both images
 * @param {string} query their settings
 */
export function cameraSpec(left, right, query) {
  return `camera:${right ? `${left},${right}` : `sbs:${left}`}${query ? `?${query}` : ""}`;
}
