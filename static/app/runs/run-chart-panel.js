/** One chart of stored runs: its curves, the values read by pointer or keys, and a description. */

import { withBand } from "../chart/speed-curves.js";
import { SpeedPlot } from "../chart/speed-plot.js";
import { h, setAttribute, setText, swatch } from "../elements/dom.js";
import { declareKeys } from "../elements/keys.js";
import { fixed, sentence, withMinus } from "../elements/words.js";
import { readingsAt } from "./run-chart-data.js";

/** @import { RunChart } from "../contract" */

declareKeys(
  "Chart of a run",
  ["← →", "Move the cursor"],
  ["Shift+← Shift+→", "Pan"],
  ["+ -", "Zoom"],
  ["0 Esc", "Zoom out fully"],
);
/** @import { Choice, ChosenCurve, Panel } from "./run-chart-data.js" */

/**
 * State shared by all panels of a comparison; seconds as in their curves.
 *
 * @typedef {object} Shared
 * @property {() => [number, number]} range that is visible
 * @property {() => [number, number]} extent of all curves
 * @property {(begin: number, end: number) => void} zoom
 * @property {(time: number | null) => void} read the values of all panels at a time
 * @property {() => number} top m/s
 * @property {boolean} noted whether it says why there is no ground truth
 */

const HEIGHT_PX = 280;
const MIN_TOP_MPS = 0.2;
// Shares of the visible range: steps of a key, and how far past a curve's end it is still read.
const STEP = 0.02;
const PAN = 0.2;
const ZOOM = 2;
const READ_PAST_END = 0.005;
const MAX_LISTED = 6;
const READING = "Hover over the chart or use the arrow keys to read values.";
const KEYS_IN_WORDS =
  "Arrow keys read values, Shift with arrow keys pans, plus and minus zoom, 0 shows all.";

export class ChartPanel {
  #host = h("div.chart", {
    tabindex: 0,
    role: "application",
    "aria-roledescription": "chart",
  });
  #reading = h("p.chart-reading.figure", READING);
  // Announced after key presses only: the pointer would be too fast for screen readers.
  #announcement = h("p.visually-hidden", { role: "status" });
  /** @type {number | null} */
  #time = null;
  /** @type {ChosenCurve[]} */
  #shown = [];
  #plot;

  /**
   * @param {Panel} panel
   * @param {Shared} shared
   * @param {boolean} several whether runs are compared, in this panel or in others
   */
  constructor(panel, shared, several) {
    this.panel = panel;
    this.shared = shared;
    this.#plot = new SpeedPlot(this.#host, {
      height: HEIGHT_PX,
      minTop: MIN_TOP_MPS,
      range: shared.range,
      top: shared.top,
      xWords: (seconds) => `${withMinus(seconds)} s`,
      xSpace: 60,
      read: (time) => shared.read(time),
      select: (begin, end) => shared.zoom(begin, end),
      all: () => shared.zoom(...shared.extent()),
    });
    this.#host.addEventListener("keydown", (event) => this.#pressed(event));
    this.#host.addEventListener("blur", () => shared.read(null));
    this.element = h(
      "section.chart-panel",
      { "aria-label": `Speeds of ${panel.title}` },
      h(
        "div",
        several && panel.charts.length === 1 ? h("h3", panel.title) : null,
        ...(shared.noted
          ? panel.charts.map((chart) => noteOf(chart, panel.charts.length > 1))
          : []),
      ),
      h(
        "div",
        ...(panel.curves.length > 0
          ? [this.#host, this.#reading, this.#announcement, factsOf(panel)]
          : [h("p.empty", "No speeds in this run.")]),
      ),
    );
  }

  /** @param {Set<Choice>} choices what to show */
  draw(choices) {
    const { curves, starts, changes, segments, gaps } = this.panel;
    this.#shown = curves
      .filter(({ choice }) => choices.has(choice))
      .map((curve) => ({ ...curve, banded: curve.banded && choices.has("band") }));
    this.#plot.draw(this.#shown, {
      starts: starts.filter(({ choice }) => choices.has(choice)),
      changes: choices.has("matched") ? changes : [],
      segments,
      gaps: choices.has("truth") ? gaps : [],
    });
    this.renderReading(this.#time);
  }

  /** Follow a change of the shared range. */
  rescale() {
    this.#plot.rescale();
    const [begin, end] = this.shared.range();
    setAttribute(
      this.#host,
      "aria-label",
      `Speed over time of ${this.panel.title}, ${fixed(begin, 1)} to ${fixed(end, 1)} seconds. ${KEYS_IN_WORDS}`,
    );
  }

  /** m/s: the highest visible value. */
  highest() {
    return this.#plot.highest();
  }

  /** Move the cursor line unless the pointer is here; read values. @param {number | null} time */
  point(time) {
    if (!this.#host.matches(":hover")) this.#plot.point(time);
    this.renderReading(time);
  }

  /** @param {number | null} time */
  renderReading(time) {
    this.#time = time;
    if (time === null) return this.#reading.replaceChildren(READING);
    const [begin, end] = this.shared.range();
    const read = readingsAt(
      this.#shown,
      time,
      Math.max(READ_PAST_END * (end - begin), 0.05),
    ).reverse();
    const values = read.map(({ label, colour, kind, speed, std }) =>
      h("span", swatch(kind, colour), ` ${label} ${withBand({ speed, std })}`),
    );
    this.#reading.replaceChildren(
      h("b", `${fixed(time, 2)} s`),
      ...(values.length ? values : [h("span", "no measurement")]),
    );
  }

  focus() {
    this.#host.focus({ preventScroll: true });
  }

  remove() {
    this.#plot.remove();
    this.element.remove();
  }

  /** @param {KeyboardEvent} event */
  #pressed(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const [begin, end] = this.shared.range();
    const span = end - begin;
    const at =
      this.#time !== null && this.#time >= begin && this.#time <= end
        ? this.#time
        : (begin + end) / 2;
    const side = event.key === "ArrowRight" ? 1 : -1;
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      if (event.shiftKey) this.shared.zoom(begin + side * PAN * span, end + side * PAN * span);
      else this.#readAt(Math.min(end, Math.max(begin, at + side * STEP * span)));
    } else if (event.key === "+" || event.key === "=") {
      this.shared.zoom(at - (at - begin) / ZOOM, at + (end - at) / ZOOM);
    } else if (event.key === "-") {
      this.shared.zoom(at - (at - begin) * ZOOM, at + (end - at) * ZOOM);
    } else if (event.key === "0" || event.key === "Escape") {
      this.shared.zoom(...this.shared.extent());
    } else {
      return;
    }
    event.preventDefault();
  }

  /** @param {number} time */
  #readAt(time) {
    this.shared.read(time);
    this.#plot.point(time);
    setText(
      this.#announcement,
      [...this.#reading.children].map(({ textContent }) => textContent?.trim()).join(", "),
    );
  }
}

/** Say why there is no truth to compare with. @param {RunChart} chart @param {boolean} named */
function noteOf({ run, aligned, sentence: reason }, named) {
  if (aligned || !reason) return null;
  return h("p.chart-note", named ? `${run.name}: ${sentence(reason)}` : sentence(reason));
}

/** Describe identity switches, new segments and gaps in ground truth. @param {Panel} panel */
function factsOf({ charts, changes, segments, gaps }) {
  const of = (/** @type {string} */ run) => (charts.length > 1 ? ` in ${run}` : "");
  const changed = changes.map(
    ({ time, body, words, run }) => `${fixed(time, 1)} s (${body}: ${words}${of(run)})`,
  );
  const missing = gaps.map(
    ({ begin, end, run }) => `${fixed(begin, 1)} to ${fixed(end, 1)} s${of(run)}`,
  );
  const begun = segments.map(({ time, run }) => `${fixed(time, 1)} s${of(run)}`);
  return h(
    "ul.chart-facts.hint",
    begun.length
      ? h("li", { "data-fact": "segments" }, `New segments, with new tracks: ${listed(begun)}.`)
      : null,
    changed.length
      ? h("li", { "data-fact": "changes" }, `Identity switches: ${listed(changed)}.`)
      : null,
    missing.length
      ? h("li", { "data-fact": "gaps" }, `Ground truth missing: ${listed(missing)}.`)
      : null,
  );
}

/** @param {string[]} words */
function listed(words) {
  const shown = words.slice(0, MAX_LISTED).join(", ");
  return words.length > MAX_LISTED ? `${shown} and ${words.length - MAX_LISTED} more` : shown;
}
