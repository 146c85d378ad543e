/** Speed over the last minute: estimates with bands, ground truth, robots' commands and wheels. */

import { h, setAttribute, setText, tint } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { sentence, withMinus } from "../elements/words.js";
import { request } from "../shell/api.js";
import { chartMenu, runOffer } from "./chart-files.js";
import { asPicture, speedsAsCsv } from "./live-speed-files.js";
import { MARKS, markLegend } from "./mark-legend.js";
import { gapsIn, legendEntries, speedAt, withBand } from "./speed-curves.js";
import { SpeedHistory } from "./speed-history.js";
import { DASHES, SpeedPlot } from "./speed-plot.js";

/** @import { History, Run } from "../contract" */

/** @import { Curve } from "./speed-curves.js" */

const SPAN_S = 60;
const DRAW_EVERY_MS = 200;
const HEIGHT_PX = 172;
const MIN_TOP_MPS = 0.5;
// A value measured longer ago than this is not current.
const READ_PAST_END_S = 0.3;
// Observations of the previous source that may arrive after it was left.
const LATE = 20;
const ORDER = { estimate: 0, stray: 0, truth: 1, commanded: 2, sent: 3, encoder: 4 };

class SpeedChart extends Part {
  #history = new SpeedHistory(SPAN_S);
  #host = h("div.chart", { role: "img" });
  #legend = h("ul.legend");
  #marks = h("p.legend.mark-keys");
  #note = h("p.chart-note", { role: "status", hidden: true });
  #empty = h(
    "p.empty",
    "No speeds yet. Curves appear when an obstacle moves or ground truth arrives.",
  );
  #hint = h("span.hint");
  #export = chartMenu(() => this.#offers());
  #plot = new SpeedPlot(this.#host, {
    height: HEIGHT_PX,
    minTop: MIN_TOP_MPS,
    range: () => [-this.#history.window_s, 0],
    xWords: (seconds) => (seconds === 0 ? "now" : `${withMinus(seconds)} s`),
    xSpace: 50,
    read: (time) => {
      this.#at = time;
      this.#renderLegend();
    },
  });
  /** Curves as drawn: seconds before the newest observation. @type {Curve[]} */
  #curves = [];
  /** @type {number | null} */
  #at = null;
  #drawnAt = 0;
  /** The source of the curves. @type {string | null} */
  #source = null;
  /** The newest run, offered while no run is being stored. @type {Run | null} */
  #last = null;

  build() {
    // Replaces the placeholder heading shown while loading.
    this.replaceChildren(
      h("div.pane-head", h("h2", "Speed"), this.#hint, this.#export),
      this.#note,
      this.#empty,
      this.#host,
      this.#marks,
      this.#legend,
    );
    this.listen("observation", () => this.#observed());
    this.listen("robots", () => this.#history.addWheels(this.hub.robots?.wheels ?? []));
    this.listen("status", () => {
      this.#followSource();
      this.#renderStatus();
    });
    this.listen("runs", () => this.#findLastRun());
    void this.#findLastRun();
    // While paused, no further observation arrives.
    if (this.hub.observation) this.#history.add(this.hub.observation);
    this.#draw();
  }

  /** Start over for another source, so its curves are not mixed with the last one's. */
  #followSource() {
    const source = this.hub.status?.source?.spec ?? this.#source;
    if (source !== this.#source && this.#source !== null) {
      this.#history = new SpeedHistory(SPAN_S, LATE);
      this.#draw();
    }
    this.#source = source;
  }

  #observed() {
    if (this.hub.observation) this.#history.add(this.hub.observation);
    const now = performance.now();
    if (now - this.#drawnAt < DRAW_EVERY_MS) return;
    this.#drawnAt = now;
    this.#draw();
  }

  #draw() {
    const history = this.#history;
    const { curves, newest, starts, changes } = history;
    const ago = (/** @type {number} */ time) => time - newest;
    this.#curves = [...curves.values()]
      .sort((a, b) => ORDER[a.kind] - ORDER[b.kind])
      .map((curve) => ({ ...curve, times: curve.times.map(ago) }));
    this.#empty.hidden = this.#curves.length > 0;
    setText(this.#hint, `m/s over the last ${history.window_s} s of source time`);
    this.#renderExport();
    this.#host.hidden = this.#curves.length === 0;
    this.#plot.draw(this.#curves, {
      starts: starts.map((start) => ({ ...start, time: ago(start.time) })),
      changes: changes.map((change) => ({ ...change, time: ago(change.time) })),
      segments: [],
      gaps: this.#curves
        .filter(({ kind }) => kind === "truth")
        .flatMap(gapsUntilNow)
        .filter(({ begin, end }) => !history.isSilent(begin + newest, end + newest)),
    });
    this.#renderLegend();
  }

  /** Show the newest values or those under the pointer. */
  #renderLegend() {
    const shown = this.#curves.filter(
      (curve) => curve.kind !== "estimate" || this.#measured(curve, this.#at),
    );
    const entries = legendEntries(shown, (curve) => withBand(this.#measured(curve, this.#at)));
    while (this.#legend.childElementCount > entries.length) this.#legend.lastElementChild?.remove();
    entries.forEach(({ curve, words: text }, index) => {
      const item = this.#legend.children[index] ?? this.#legend.appendChild(makeLegendItem());
      const [swatch, words] = item.children;
      if (!swatch || !words) return;
      setAttribute(swatch, "data-kind", curve.kind);
      if (swatch instanceof HTMLElement) tint(swatch, curve.colour);
      setText(words, text);
    });
    // The same marks regardless of what is visible now, so the layout stays still.
    const truth = this.#curves.some(({ kind }) => kind === "truth");
    const marks = this.#marksDrawn(truth);
    if (this.#marks.childElementCount !== marks.length)
      this.#marks.replaceChildren(...markLegend(marks));
    const now = shown.map((curve) => `${curve.label} ${withBand(this.#measured(curve, null))}`);
    setAttribute(this.#host, "aria-label", `Speed over the last minute. Now: ${now.join(", ")}`);
  }

  /** @param {boolean} truth whether there is any @returns {import("./mark-legend.js").Mark[]} */
  #marksDrawn(truth) {
    if (this.#curves.length === 0) return [];
    return truth ? ["band", "start", "change", "gap"] : ["band", "start"];
  }

  /** @param {Curve} curve @param {number | null} at seconds; null is now */
  #measured(curve, at) {
    return speedAt(curve, at ?? 0, READ_PAST_END_S);
  }

  #renderStatus() {
    const truth = this.hub.status?.truth ?? null;
    const words = [truth?.sentence, truth?.trouble]
      .flatMap((text) => (text ? [sentence(text)] : []))
      .join(" ");
    this.#note.hidden = words === "";
    setAttribute(this.#note, "data-tone", truth?.aligned && !truth.trouble ? "calm" : "open");
    setText(this.#note, words);
    this.#renderExport();
  }

  #renderExport() {
    this.#export.hidden = this.#curves.length === 0 && !this.#last;
  }

  /** Offer the visible curves, made in the page, and the whole newest run once it has ended. */
  #offers() {
    const { status } = this.hub;
    const last = status?.run || this.#last?.state === "running" ? null : this.#last;
    const seen =
      this.#curves.length > 0
        ? [
            {
              words: `Visible curves${status?.run ? "; stop the run to export SVG and PDF" : ""}`,
              files: [
                {
                  format: "csv",
                  title: "Curves as a CSV table",
                  make: async () =>
                    this.#file(
                      "csv",
                      speedsAsCsv(this.#history.curves.values(), this.#history.playing),
                    ),
                },
                {
                  format: "png",
                  title: "Chart as an image",
                  make: async () => this.#file("png", await this.#picture()),
                },
              ],
            },
          ]
        : [];
    return last ? [...seen, runOffer(last, null)] : seen;
  }

  #picture() {
    const { canvas } = this.#plot;
    if (!canvas) throw new Error("The chart is empty.");
    const truth = this.#curves.some(({ kind }) => kind === "truth");
    const entries = [
      ...this.#curves.map(({ kind, label, colour }) => ({ kind, label, colour })),
      ...this.#marksDrawn(truth).map((kind) => ({ kind, ...MARKS[kind] })),
    ].map(({ kind, label, colour }) => ({
      kind,
      label,
      colour: this.#plot.resolved(colour),
      dash: DASHES[/** @type {keyof typeof DASHES} */ (kind)] ?? [],
    }));
    return asPicture(canvas, entries, {
      ground: this.#plot.resolved("--surface"),
      text: this.#plot.resolved("--text"),
    });
  }

  /** @param {string} format @param {Blob} blob */
  #file(format, blob) {
    return { blob, name: `${this.hub.status?.run?.name ?? "speeds"}.${format}` };
  }

  async #findLastRun() {
    /** @type {History | null} */
    const found = await request("GET", "/history?limit=1").catch(() => null);
    this.#last = found?.runs[0] ?? null;
    this.#renderStatus();
  }
}

function makeLegendItem() {
  return h("li", h("span.swatch.line", { "aria-hidden": "true" }), h("span.figure"));
}

/** Gaps, including one still open at present. @param {Curve} curve */
function gapsUntilNow(curve) {
  const gaps = gapsIn(curve);
  const last = curve.speeds.findLastIndex((speed) => speed !== null);
  if (last >= 0 && last < curve.speeds.length - 1)
    gaps.push({ begin: Number(curve.times[last]), end: 0 });
  return gaps;
}

customElements.define("observer-speed-chart", SpeedChart);
