/**
 * <observer-run-chart>: speeds of stored runs over time, one or several, with their errors.
 *
 * `show(charts)` takes answers of GET /api/runs/{id}/chart. The element itself keeps the zoom, the
 * hidden curves and the arrangement of several runs.
 */

import { chartMenu, runOffer } from "../chart/chart-files.js";
import { markLegend } from "../chart/mark-legend.js";
import { button, h, setText, swatch } from "../elements/dom.js";
import { trackColour } from "../elements/words.js";
import { extentOf, originsOf, panelsOf, sameRecording } from "./run-chart-data.js";
import { errorSection } from "./run-chart-errors.js";
import { ChartPanel } from "./run-chart-panel.js";

/** @import { RunChart as StoredChart } from "../contract" */
/** @import { Choice } from "./run-chart-data.js" */

// The zoom stops here.
const MIN_SPAN_S = 0.2;
const ZOOM = 2;

/** @type {{choice: Choice, label: string, kind: string, colour: string | null, shown: boolean}[]} colour null: that of the first track */
const CHOICES = [
  { choice: "matched", label: "Estimate", kind: "estimate", colour: null, shown: true },
  { choice: "band", label: "95 % interval", kind: "band", colour: null, shown: true },
  { choice: "truth", label: "Ground truth", kind: "truth", colour: "--text", shown: true },
  { choice: "commanded", label: "Commanded", kind: "commanded", colour: "--muted", shown: true },
  { choice: "encoder", label: "Wheel encoders", kind: "encoder", colour: "--warn", shown: true },
  { choice: "stray", label: "Unmatched", kind: "stray", colour: "--muted", shown: true },
  {
    choice: "own",
    label: "Observer's own speed",
    kind: "encoder",
    colour: "--accent",
    shown: false,
  },
];

let made = 0;

export class RunChart extends HTMLElement {
  /** Called with the time read, s on the first run's clock. @type {((time: number) => void) | null} */
  pointed = null;

  #name = `run-chart-${(made += 1)}`;
  #begin = h("input", {
    type: "number",
    step: "any",
    id: `${this.#name}-begin`,
    "aria-label": "Visible range from, seconds",
  });
  #end = h("input", {
    type: "number",
    step: "any",
    id: `${this.#name}-end`,
    "aria-label": "Visible range to, seconds",
  });
  #layout = h("fieldset.chips", { hidden: true });
  #tools = h("div.chart-tools");
  #clock = h("span.hint");
  #panelHost = h("div.chart-panels");
  #legend = h("fieldset.chips.chart-legend");
  #errors = h("div");
  /** @type {StoredChart[]} */
  #charts = [];
  #overlaid = false;
  /** @type {ChartPanel[]} */
  #panels = [];
  /** @type {Set<Choice>} */
  #choices = new Set(CHOICES.flatMap(({ choice, shown }) => (shown ? [choice] : [])));
  /** @type {[number, number]} */
  #extent = [0, 1];
  /** @type {[number, number]} */
  #range = [0, 1];
  /** Time of the cursor line while nothing is pointed at. @type {number | null} */
  #at = null;
  #isAlone;

  /** @param {{alone?: boolean}} options alone: without what the page of a single run has itself: its exports, and what is said of its ground truth */
  constructor({ alone = true } = {}) {
    super();
    this.#isAlone = alone;
  }

  connectedCallback() {
    if (!this.childElementCount) this.#build();
    this.#rebuild();
  }

  disconnectedCallback() {
    this.#clear();
  }

  /**
   * Show runs; the zoom is kept if the same runs are shown again, as while one is in progress.
   *
   * @param {StoredChart[]} charts one, or several to compare with the first
   */
  show(charts) {
    const ids = (/** @type {StoredChart[]} */ some) => some.map(({ run }) => run.id).join(" ");
    const again = ids(charts) === ids(this.#charts) && !this.#showsAll();
    this.#charts = charts;
    this.#extent = extentOf(charts);
    if (!again) this.#range = this.#extent;
    if (this.isConnected) this.#rebuild();
  }

  /** Move the cursor line to the time shown elsewhere on the page. @param {number | null} time */
  mark(time) {
    this.#at = time;
    this.#point(time);
  }

  /** Offer the visible part of each run as files. */
  offers() {
    const origins = originsOf(this.#charts);
    const [begin, end] = this.#range;
    const all = this.#showsAll();
    return this.#charts.map(({ run }, at) => {
      const origin = Number(origins[at]);
      // Times on each run's own clock.
      return runOffer(run, all ? null : { begin: begin + origin, end: end + origin });
    });
  }

  #showsAll() {
    return this.#range[0] <= this.#extent[0] && this.#range[1] >= this.#extent[1];
  }

  #build() {
    const zoomOut = button("−", () => this.#zoomBy(ZOOM), {
      class: "button icon-button",
      "aria-label": "Zoom out",
      title: "Zoom out",
    });
    const zoomIn = button("+", () => this.#zoomBy(1 / ZOOM), {
      class: "button icon-button",
      "aria-label": "Zoom in",
      title: "Zoom in",
    });
    const all = button("Show all", () => this.#zoom(...this.#extent), {
      title: "Show all (double-click)",
    });
    this.#begin.addEventListener("change", () =>
      this.#typed(this.#begin.valueAsNumber, this.#range[1]),
    );
    this.#end.addEventListener("change", () =>
      this.#typed(this.#range[0], this.#end.valueAsNumber),
    );
    for (const input of [this.#begin, this.#end])
      input.addEventListener("blur", () => this.#showRange());
    this.#layout.append(
      h("legend.visually-hidden", "Comparison layout"),
      ...["Side by side", "Overlaid"].map((words, at) => {
        const input = h("input", {
          type: "radio",
          name: `${this.#name}-layout`,
          checked: at === 0,
        });
        input.addEventListener("change", () => {
          this.#overlaid = at === 1;
          this.#rebuild();
        });
        return h("label", input, words);
      }),
    );
    this.#tools.append(
      this.#layout,
      h(
        "div.row",
        h("span.from", "From"),
        this.#begin,
        h("span", "to"),
        this.#end,
        h("span.unit", "s"),
        zoomOut,
        zoomIn,
        all,
      ),
    );
    if (this.#isAlone) this.#tools.append(chartMenu(() => this.offers()));
    this.append(this.#tools, this.#panelHost, this.#legend, this.#clock, this.#errors);
  }

  #clear() {
    for (const panel of this.#panels) panel.remove();
    this.#panels = [];
  }

  #rebuild() {
    const focused = this.#panels.findIndex(({ element }) =>
      element.contains(document.activeElement),
    );
    const opened = this.#errors.querySelector("details")?.open ?? false;
    this.#clear();
    const several = this.#charts.length > 1;
    this.toggleAttribute("data-empty", this.#charts.length === 0);
    const panels = panelsOf(this.#charts, several && this.#overlaid);
    this.#layout.hidden = !several;
    this.#panels = panels.map(
      (panel) =>
        new ChartPanel(
          panel,
          {
            range: () => this.#range,
            extent: () => this.#extent,
            zoom: (begin, end) => this.#zoom(begin, end),
            read: (time) => this.#read(time),
            top: () => Math.max(...this.#panels.map((each) => each.highest())),
            noted: this.#isAlone,
          },
          several,
        ),
    );
    const drawn = panels.some(({ curves }) => curves.length > 0);
    this.#tools.hidden = this.#clock.hidden = this.#errors.hidden = !drawn;
    this.#panelHost.replaceChildren(...this.#panels.map(({ element }) => element));
    setText(
      this.#clock,
      sameRecording(this.#charts)
        ? "Speed in m/s over source time in s. Drag to zoom in, double-click to show all."
        : "Speed in m/s over time in s since the start of each run. Drag to zoom in, double-click to show all.",
    );
    this.#renderLegend();
    this.#draw();
    // Do not overwrite what is being typed, as while a running run is read again.
    this.#zoom(...this.#range, document.activeElement);
    const told = !this.#isAlone && !this.#charts.some(({ aligned }) => aligned);
    this.#errors.replaceChildren(
      ...(told ? [] : [errorSection(this.#charts, several && this.#overlaid)]),
    );
    this.#errors.querySelector("details")?.toggleAttribute("open", opened);
    this.#panels[focused]?.focus();
  }

  #draw() {
    for (const panel of this.#panels) panel.draw(this.#choices);
    // The panels share the upper end, which depends on all visible curves, known only now.
    for (const panel of this.#panels) panel.rescale();
    this.#restoreCursor();
  }

  /** Make a legend of what these runs contain; pressing an entry toggles it. */
  #renderLegend() {
    const has = new Set(
      this.#panels.flatMap(({ panel }) => panel.curves.map(({ choice }) => choice)),
    );
    if (has.has("matched")) has.add("band");
    const several = this.#overlaid && this.#charts.length > 1;
    const first = this.#panels[0]?.panel.curves.find(({ choice }) => choice === "matched")?.colour;
    const entries = CHOICES.filter(({ choice }) => has.has(choice)).map(
      ({ choice, label, kind, colour }) => {
        const input = h("input", { type: "checkbox", checked: this.#choices.has(choice) });
        input.addEventListener("change", () => {
          if (input.checked) this.#choices.add(choice);
          else this.#choices.delete(choice);
          this.#draw();
        });
        return h(
          "label",
          input,
          several && (kind === "estimate" || kind === "band")
            ? null
            : swatch(kind, colour ?? first ?? "--muted"),
          label,
        );
      },
    );
    const runs = several
      ? this.#charts.map(({ run }, at) =>
          h("span.run-label", swatch("estimate", trackColour(at)), run.name),
        )
      : [];
    // Marks are visible only with their curves, so they have no toggle of their own.
    const marks = markLegend(
      /** @type {const} */ (["start", "change", "segment", "gap"]).filter((mark) =>
        this.#panels.some(({ panel }) => panel[`${mark}s`].length > 0),
      ),
    );
    this.#legend.replaceChildren(
      h("legend.visually-hidden", "Curves"),
      ...runs,
      ...entries,
      ...marks,
    );
  }

  /** @param {number | null} time null: the pointer has left */
  #read(time) {
    if (time !== null && this.pointed) {
      this.#at = time;
      this.pointed(time);
    }
    this.#point(time ?? this.#at);
  }

  /** @param {number | null} time */
  #point(time) {
    for (const panel of this.#panels) panel.point(time);
  }

  /** Move the cursor line back in place after the plots were rescaled. */
  #restoreCursor() {
    if (this.#at !== null) queueMicrotask(() => this.#point(this.#at));
  }

  /**
   * Take a typed range; an end beyond the other moves both.
   *
   * @param {number} begin
   * @param {number} end
   */
  #typed(begin, end) {
    const span = this.#range[1] - this.#range[0];
    if (begin < end || Number.isNaN(begin + end)) this.#zoom(begin, end);
    else if (end === this.#range[1]) this.#zoom(begin, begin + span);
    else this.#zoom(end - span, end);
  }

  /** @param {number} factor */
  #zoomBy(factor) {
    const [begin, end] = this.#range;
    const middle = (begin + end) / 2;
    const half = ((end - begin) / 2) * factor;
    this.#zoom(middle - half, middle + half);
  }

  /**
   * Zoom to a range, clamped to the extent; an invalid range changes nothing.
   *
   * @param {number} begin
   * @param {number} end
   * @param {Element | null} [typed] a field of the range that keeps its text
   */
  #zoom(begin, end, typed = null) {
    const [first, last] = this.#extent;
    if (begin < end) {
      const span = Math.min(last - first, Math.max(end - begin, MIN_SPAN_S));
      const from = Math.min(Math.max(begin, first), last - span);
      this.#range = [from, from + span];
    }
    this.#showRange(typed);
    for (const panel of this.#panels) panel.rescale();
    this.#restoreCursor();
  }

  /** @param {Element | null} [typed] a field that keeps its text */
  #showRange(typed = null) {
    [this.#begin, this.#end].forEach((input, at) => {
      if (input !== typed) input.value = this.#range[at].toFixed(2);
    });
  }
}

customElements.define("observer-run-chart", RunChart);
