/** Speed over the last minute: estimate with its band, truth, and what robots are told and do. */

import uPlot from "../vendor/uplot/uPlot.esm.js";
import { request } from "./api.js";
import { h, icon, setAttribute, setText } from "./dom.js";
import { Part } from "./part.js";
import { SpeedHistory } from "./speed-history.js";
import { fixed } from "./words.js";

/** @typedef {import("./speed-history.js").Column} Column */

const SPAN_S = 60;
const DRAW_EVERY_MS = 200;
const HEIGHT_PX = 190;
// The chart's top is at least this, so that noise around standing still stays small.
const TOP_AT_LEAST_MPS = 0.5;
const LEGEND_ORDER = { estimate: 0, truth: 1, commanded: 2, sent: 3, encoder: 4 };
// Of the observer and of the obstacle.
const ROBOT_COLOURS = ["--accent", "--warn"];

class SpeedChart extends Part {
  #history = new SpeedHistory(SPAN_S);
  #host = h("div", { class: "chart", role: "img" });
  #legend = h("ul", { class: "legend" });
  #empty = h("p", { class: "empty" }, "No speed yet. Curves appear as soon as an obstacle moves or truth is known.");
  #probe = h("span", { hidden: true });
  #csv = h("a", { class: "button", hidden: true, download: true }, icon("download"), "CSV");
  /** @type {uPlot | null} */
  #plot = null;
  #keys = "";
  #drawnAt = 0;
  /** @type {string | null} */
  #runId = null;

  build() {
    this.append(
      h("div", { class: "pane-head" }, h("h2", {}, "Speed"),
        h("span", { class: "hint" }, "m/s over the last 60 s of the source's time"), this.#csv),
      this.#empty, this.#host, this.#legend, this.#probe);
    this.hear("observation", () => this.#observed());
    this.hear("status", () => this.#renderLink());
    this.hear("runs", () => void this.#findLastRun());
    this.hear("themechange", () => this.#rebuild(), window);
    new ResizeObserver(() => this.#resize()).observe(this.#host);
    void this.#findLastRun();
    this.#draw();
  }

  #observed() {
    if (this.hub.observation) this.#history.add(this.hub.observation, this.hub.robots);
    const now = performance.now();
    if (now - this.#drawnAt < DRAW_EVERY_MS) return;
    this.#drawnAt = now;
    this.#draw();
  }

  #draw() {
    const columns = this.#columns();
    this.#empty.hidden = columns.length > 0;
    this.#host.hidden = columns.length === 0;
    const keys = columns.map((column) => column.key).join(" ");
    if (keys !== this.#keys || !this.#plot) {
      this.#keys = keys;
      this.#rebuild();
    } else {
      this.#plot.setData(this.#data(columns));
    }
    this.#renderLegend(columns);
  }

  #columns() {
    return [...this.#history.columns.values()].sort((a, b) => LEGEND_ORDER[a.kind] - LEGEND_ORDER[b.kind]);
  }

  #rebuild() {
    this.#plot?.destroy();
    this.#plot = null;
    const columns = this.#columns();
    if (columns.length === 0 || this.#host.clientWidth === 0) return;
    const colour = (/** @type {string} */ name) => this.#resolved(name);
    this.#plot = new uPlot(
      {
        width: this.#host.clientWidth,
        height: HEIGHT_PX,
        legend: { show: false },
        padding: [8, 12, 0, 0],
        cursor: { drag: { x: false, y: false } },
        hooks: { setCursor: [() => this.#renderLegend(this.#columns())] },
        scales: {
          x: { time: false, range: () => [-SPAN_S, 0] },
          y: { range: () => [0, Math.max(TOP_AT_LEAST_MPS, this.#highest() * 1.15)] },
        },
        axes: [
          { ...axis(colour, (seconds) => (seconds === 0 ? "now" : `${seconds} s`), 50), size: 28 },
          { ...axis(colour, (speed) => String(speed), 36), size: 44 },
        ],
        series: [{}, ...columns.flatMap((column) => seriesOf(column, colour))],
        bands: bandsOf(columns, colour),
      },
      this.#data(columns),
      this.#host,
    );
  }

  /** Of the curves alone: a wide band may leave the chart, the curves never do. */
  #highest() {
    let highest = 0;
    for (const { values } of this.#history.columns.values()) {
      for (const value of values) if (value !== null && value > highest) highest = value;
    }
    return highest;
  }

  /** A colour of tokens.css as the canvas understands it. @param {string} name */
  #resolved(name) {
    this.#probe.style.color = `var(${name})`;
    return getComputedStyle(this.#probe).color;
  }

  /** @param {Column[]} columns @returns {import("../vendor/uplot/uPlot.esm.js").AlignedData} */
  #data(columns) {
    const newest = this.#history.times.at(-1) ?? 0;
    const times = this.#history.times.map((time) => time - newest);
    const rows = columns.flatMap(({ kind, values, stds }) => {
      if (kind !== "estimate") return [values];
      const edge = (/** @type {1 | -1} */ side) =>
        values.map((value, i) => {
          const std = stds[i];
          return value === null || std === null || std === undefined ? null : Math.max(0, value + side * std);
        });
      return [edge(1), edge(-1), values];
    });
    return [times, ...rows];
  }

  #resize() {
    if (!this.#plot) return this.#rebuild();
    const width = this.#host.clientWidth;
    if (width > 0 && width !== this.#plot.width) this.#plot.setSize({ width, height: HEIGHT_PX });
  }

  /** Newest values, or those under the pointer. @param {Column[]} all */
  #renderLegend(all) {
    const at = this.#plot?.cursor.idx ?? this.#history.times.length - 1;
    const columns = all.filter((column) => column.kind !== "estimate" || typeof column.values[at] === "number");
    while (this.#legend.childElementCount > columns.length) this.#legend.lastElementChild?.remove();
    columns.forEach((column, index) => {
      const item = this.#legend.children[index] ?? this.#legend.appendChild(makeLegendItem());
      const [swatch, words] = item.children;
      if (!swatch || !words) return;
      setAttribute(swatch, "data-kind", column.kind);
      setAttribute(swatch, "data-track", column.kind === "estimate" ? String(column.colour) : null);
      setAttribute(swatch, "data-robot", column.kind === "sent" || column.kind === "encoder" ? String(column.colour) : null);
      setText(words, `${column.label} ${valueInWords(column, at)}`);
    });
    const newest = columns.map((column) => `${column.label} ${valueInWords(column, this.#history.times.length - 1)}`);
    setAttribute(this.#host, "aria-label", `Speed over the last minute. Now: ${newest.join(", ")}`);
  }

  #renderLink() {
    const id = this.hub.status?.run?.id ?? this.#runId;
    this.#csv.hidden = id === null;
    if (id === null || id === this.#csv.dataset.run) return;
    this.#runId = id;
    this.#csv.dataset.run = id;
    this.#csv.href = `/api/runs/${encodeURIComponent(id)}/speeds?format=csv`;
    this.#csv.title = "Speeds of the newest run as CSV";
    this.#csv.setAttribute("aria-label", this.#csv.title);
  }

  async #findLastRun() {
    /** @type {import("./types.js").Run[]} */
    const runs = await request("GET", "/runs").catch(() => []);
    const newest = runs.reduce(
      (best, run) => (best && best.started_at > run.started_at ? best : run),
      /** @type {import("./types.js").Run | null} */ (null),
    );
    this.#runId = newest?.id ?? null;
    this.#renderLink();
  }
}

function makeLegendItem() {
  return h("li", {}, h("span", { class: "swatch line", "aria-hidden": "true" }), h("span", { class: "figure" }));
}

/**
 * @param {Column} column
 * @param {number} at index of the row
 */
function valueInWords(column, at) {
  const value = column.values[at];
  if (value === null || value === undefined) return "–";
  const std = column.stds[at];
  return std === null || std === undefined ? fixed(value, 2) : `${fixed(value, 2)} ± ${fixed(std, 2)}`;
}

/**
 * @param {(name: string) => string} colour
 * @param {(value: number) => string} words
 * @param {number} space least distance of two ticks, px
 */
function axis(colour, words, space) {
  return {
    stroke: colour("--muted"),
    font: "11px sans-serif",
    space,
    grid: { stroke: colour("--grid"), width: 1 },
    ticks: { stroke: colour("--grid"), width: 1, size: 4 },
    values: (/** @type {unknown} */ _plot, /** @type {number[]} */ splits) => splits.map(words),
  };
}

/**
 * @param {Column} column
 * @param {(name: string) => string} colour
 */
function seriesOf({ kind, label, colour: track }, colour) {
  const points = { show: false };
  if (kind === "truth") return [{ label, stroke: colour("--text"), width: 1.5, dash: [6, 4], points }];
  if (kind === "commanded") return [{ label, stroke: colour("--muted"), width: 1.5, dash: [2, 3], points }];
  const robot = colour(ROBOT_COLOURS[track] ?? "--muted");
  if (kind === "sent") return [{ label, stroke: robot, width: 1.5, dash: [2, 3], points }];
  if (kind === "encoder") return [{ label, stroke: robot, width: 1.5, points }];
  const edge = { stroke: "transparent", width: 0, points };
  return [
    { ...edge, label: `${label}, upper` },
    { ...edge, label: `${label}, lower` },
    { label, stroke: colour(`--track-${track}`), width: 2, points: { show: true, size: 3, width: 0, filter: lonely } },
  ];
}

/**
 * Only points without neighbours are drawn as dots; the others are seen as a line.
 *
 * @param {uPlot} plot
 * @param {number} index of the series
 * @returns {number[]}
 */
function lonely(plot, index) {
  const values = plot.data[index] ?? [];
  return [...values.keys()].filter(
    (i) => typeof values[i] === "number" && typeof values[i - 1] !== "number" && typeof values[i + 1] !== "number",
  );
}

/**
 * @param {Column[]} columns
 * @param {(name: string) => string} colour
 */
function bandsOf(columns, colour) {
  let next = 1;
  return columns.flatMap((column) => {
    const upper = next;
    next += column.kind === "estimate" ? 3 : 1;
    if (column.kind !== "estimate") return [];
    /** @type {[number, number]} */
    const series = [upper, upper + 1];
    return [{ series, fill: `color-mix(in srgb, ${colour(`--track-${column.colour}`)} 22%, transparent)` }];
  });
}

customElements.define("observer-speed-chart", SpeedChart);
