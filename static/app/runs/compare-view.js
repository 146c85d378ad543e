/** Several runs side by side: their speeds, errors and differing settings. */

import { h, setText, table, tableRow } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { duration, when } from "../elements/words.js";
import { differences } from "../parameters/value-words.js";
import { ApiError, request } from "../shell/api.js";
import { RunChart } from "./run-chart.js";
import { methodsHref } from "./methods-words.js";
import { runHref } from "./run-words.js";

/** @import { RunChart as Chart } from "../contract" */
/** @import { ParameterEntry, Values } from "../parameters/parameter-store.js" */

// A re-run is aligned with ground truth only after it ends; until then, ask again.
const RETRY_MS = 4000;
const MAX_RETRIES = 15;

export class CompareView extends Part {
  /** Called with the title of the view. @type {(words: string) => void} */
  named = () => {};

  #chart = new RunChart();
  #waiting = h("p.empty", { role: "status" });
  #frames = h("p");
  #table = h("div");
  #error = h("p.field-error", { role: "alert" });
  /** @type {string[]} */
  #ids = [];
  #asked = 0;
  #retries = 0;
  #timer = 0;

  build() {
    this.append(this.#error, this.#waiting, this.#frames, this.#chart, this.#table);
    this.listen("reconnected", () => this.#load());
  }

  /** @param {string[]} ids empty: another view is shown */
  show(ids) {
    this.hidden = ids.length === 0;
    this.#ids = ids;
    this.#retries = 0;
    clearTimeout(this.#timer);
    this.#chart.show([]);
    this.#frames.replaceChildren();
    this.#table.replaceChildren();
    setText(this.#error, "");
    setText(this.#waiting, "Reading the speeds from the recordings…");
    void this.#load();
  }

  async #load() {
    const ids = this.#ids;
    // Even if nothing is asked now: an answer still to come is for a view that was left.
    const asked = ++this.#asked;
    if (ids.length === 0) return;
    try {
      const [schema, ...charts] = await Promise.all([
        /** @type {Promise<ParameterEntry[]>} */ (request("GET", "/parameters/schema")),
        ...ids.map(
          (id) =>
            /** @type {Promise<Chart>} */ (request("GET", `/runs/${encodeURIComponent(id)}/chart`)),
        ),
      ]);
      if (asked !== this.#asked) return;
      setText(this.#waiting, "");
      setText(this.#error, "");
      this.named(`Compare ${charts.map(({ run }) => run.name).join(" and ")}`);
      this.#chart.show(charts);
      if (areSameFrames(charts))
        this.#frames.replaceChildren(
          h("a", { href: methodsHref(ids) }, "Side by side, frame by frame"),
        );
      this.#table.replaceChildren(settingsTable(charts, schema));
      this.#retries += 1;
      if (isAwaitingTruth(charts) && this.#retries < MAX_RETRIES)
        this.#timer = setTimeout(() => void this.#load(), RETRY_MS);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (asked !== this.#asked) return;
      setText(this.#waiting, "");
      setText(this.#error, error.message);
    }
  }
}

/** @param {Chart[]} charts */
function isAwaitingTruth(charts) {
  const aligned = new Set(charts.flatMap(({ run, aligned }) => (aligned ? [run.id] : [])));
  return charts.some(
    ({ run, aligned: there }) => !there && run.rerun_of !== null && aligned.has(run.rerun_of),
  );
}

/** @param {Chart[]} charts @returns whether they are two runs of the same frames */
function areSameFrames(charts) {
  const [first, second, more] = charts.map(({ run }) => run);
  if (!first || !second || more) return false;
  return (
    second.rerun_of === first.id ||
    first.rerun_of === second.id ||
    (first.rerun_of !== null && first.rerun_of === second.rerun_of)
  );
}

/**
 * Return a table of the settings that differ.
 *
 * @param {Chart[]} charts
 * @param {ParameterEntry[]} schema
 */
function settingsTable(charts, schema) {
  const runs = charts.map(({ run }) => run);
  const differing = differences(
    schema,
    runs.map(({ parameters }) => /** @type {Values} */ (parameters)),
  );
  /** @type {[string, (chart: Chart) => string][]} */
  const rows = [
    ["Source", ({ run }) => run.source],
    ["Started", ({ run }) => when(run.started_at)],
    ["Duration", ({ run }) => duration(run.duration_s)],
    ["Frames", ({ run }) => String(run.frames)],
    ["Segments", ({ run }) => String(run.segments)],
    ["Ground truth", ({ aligned, sentence }) => sentence ?? (aligned ? "aligned" : "none")],
  ];
  return table(
    "compared",
    [null, ...runs.map((run) => h("a", { href: runHref(run.id) }, run.name))],
    [
      ...rows.map(([name, text]) => tableRow(name, ...charts.map(text))),
      ...differing.map(({ entry, words }) => tableRow(entry.title, ...words)),
    ],
    differing.length === 0
      ? "All parameters are the same."
      : "Run details and parameters that differ.",
  );
}

customElements.define("observer-run-compare", CompareView);
