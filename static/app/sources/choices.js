/**
 * Sources to choose from: what the server lists, the cameras it found, the runs it keeps. Pure
 * functions.
 */

import { duration, when } from "../elements/words.js";
import { facts, hasImages } from "../runs/run-words.js";

/** @import { BoardFacts, Run, SourceEntry, VideoDevice } from "../contract" */

/**
 * @typedef {object} Choice
 * @property {string} spec the text that opens it
 * @property {string} title
 * @property {string} line what it is, in a few words
 * @property {string} help all that is known of it
 * @property {SourceEntry["group"]} group
 * @property {boolean} template words in capitals stand for what is to be typed
 * @property {string | null} picture where it can be had
 * @property {number | null} recent place among those opened lately
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
      spec: cameraSpec(nameOf(left), nameOf(right), usualMode(left)),
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
 * One list without what is in it twice: the first of each stays, at the place among the recent
 * ones that any of them has.
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
 * The first few, and always the one that is open.
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
 * What is suggested for what was typed: those opened lately first, then by how well they match.
 *
 * @param {Choice[]} choices
 * @param {string} typed all of its words are in what is suggested; empty: everything matches
 * @param {number} most of each group, so that no group hides another one
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
  const told = `${named} ${help}`.toLowerCase();
  return words.every((word) => told.includes(word)) ? 1 : Infinity;
}

/**
 * @param {string} spec a template
 * @returns {[number, number]} where what has to be replaced begins and ends
 */
export function placeholders(spec) {
  const found = [...spec.matchAll(PLACEHOLDER)];
  const last = found.at(-1);
  return last ? [found[0]?.index ?? 0, last.index + last[0].length] : [0, spec.length];
}

/**
 * The text that names a source in the fewest words: a run's recording by the run, not by its path.
 *
 * @param {string} spec
 */
export function shortSpec(spec) {
  const run = RECORDING.exec(spec)?.[1];
  return run ? `run:${run}` : spec;
}

/**
 * The board that a simulated person shows to the cameras of a source.
 *
 * @param {SourceEntry[]} entries
 * @param {string} spec with a seed or without
 * @returns {BoardFacts | null}
 */
export function boardOf(entries, spec) {
  const scenario = spec.trim().split("?")[0];
  return entries.find((entry) => entry.spec === scenario)?.board ?? null;
}

/** @param {VideoDevice} camera @returns {string} the name that stays when it is plugged in again */
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
 * Compressed images of the usual size: what two cameras on one port can carry.
 *
 * @param {VideoDevice | undefined} camera
 * @returns {string} its query, empty where the camera has none such
 */
export function usualMode(camera) {
  return modesOf(camera).find(([, words]) => words.startsWith("640 × 480, MJPG"))?.[0] ?? "";
}

/**
 * @param {string} left
 * @param {string} right empty where the left one delivers both images
 * @param {string} query how they are set
 */
export function cameraSpec(left, right, query) {
  return `camera:${right ? `${left},${right}` : `sbs:${left}`}${query ? `?${query}` : ""}`;
}
