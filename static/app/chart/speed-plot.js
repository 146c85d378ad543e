/** A plot of speed curves, live or of a stored run: bands, gaps and identity switches. */

import uPlot from "../../vendor/uplot/uPlot.esm.js";
import { h } from "../elements/dom.js";
import { joined } from "./speed-curves.js";

/** @import { Curve } from "./speed-curves.js" */

/**
 * Marks in addition to the curves; times as in the curves.
 *
 * @typedef {object} Marks
 * @property {{time: number, speed: number, words: string, colour: string}[]} starts of tracks
 * @property {{time: number, words: string, colour: string}[]} changes of a body's identity
 * @property {{time: number}[]} segments where all tracks begin anew
 * @property {{begin: number, end: number}[]} gaps in truth, drawn as bars below the chart
 */

/**
 * @typedef {object} PlotOptions
 * @property {number} height px
 * @property {number} minTop m/s: minimum upper end, so that noise at rest stays small
 * @property {() => [number, number]} range visible range, seconds
 * @property {(seconds: number) => string} xWords
 * @property {number} xSpace least distance between ticks, px
 * @property {() => number | null} [top] m/s, the upper end where several charts share it
 * @property {(time: number | null) => void} read called as the pointer moves; null: it has left
 * @property {(begin: number, end: number) => void} [select] called with a dragged range
 * @property {() => void} [all] called on double click
 */

/** @type {Marks} */
const NO_MARKS = { starts: [], changes: [], segments: [], gaps: [] };

/** Dashes of the curves that the observer did not measure. @type {Partial<Record<import("./speed-curves.js").Kind, number[]>>} */
export const DASHES = { truth: [6, 4], commanded: [2, 3], sent: [2, 3], encoder: [9, 3, 2, 3] };

const LABEL_PX = 11;
// A label closer than this to the previous one would overlap it.
const LABEL_SPACE_PX = 26;
const GAP_BAR_PX = 4;
const LABEL_ROWS = 3;
const HEADROOM = 1.15;

export class SpeedPlot {
  #probe = h("span.colour-probe", { hidden: true });
  /** @type {Curve[]} */
  #curves = [];
  /** @type {Marks} */
  #marks = NO_MARKS;
  /** @type {uPlot | null} */
  #plot = null;
  #drawn = "";
  #gone = new AbortController();
  #resized = new ResizeObserver(() => this.#resize());

  /**
   * @param {HTMLElement} host
   * @param {PlotOptions} options
   */
  constructor(host, options) {
    this.host = host;
    this.options = options;
    host.append(this.#probe);
    this.#resized.observe(host);
    window.addEventListener("themechange", () => this.#rebuild(), { signal: this.#gone.signal });
  }

  /** @param {Curve[]} curves @param {Marks} marks */
  draw(curves, marks) {
    this.#curves = curves;
    this.#marks = marks;
    const drawn = curves.map(({ key, colour, banded }) => `${key} ${colour} ${banded}`).join("\n");
    if (drawn === this.#drawn && this.#plot) this.#plot.setData(joined(curves));
    else this.#rebuild();
    this.#drawn = drawn;
  }

  /** The range has changed. */
  rescale() {
    const [min, max] = this.options.range();
    this.#plot?.setScale("x", { min, max });
  }

  /** Move the cursor line to a time. @param {number | null} time */
  point(time) {
    const plot = this.#plot;
    if (!plot) return;
    const left = time === null ? -10 : plot.valToPos(time, "x");
    plot.setCursor({ left, top: time === null ? -10 : 0 }, false);
  }

  /** The canvas as drawn now, for export; null where nothing is drawn. @returns {HTMLCanvasElement | null} */
  get canvas() {
    return this.#plot?.ctx.canvas ?? null;
  }

  /** m/s: the highest visible value of the curves alone; a wide band may leave the chart. */
  highest() {
    const [begin, end] = this.options.range();
    let highest = 0;
    for (const { times, speeds } of this.#curves) {
      for (const [i, speed] of speeds.entries()) {
        const time = Number(times[i]);
        if (speed !== null && speed > highest && time >= begin && time <= end) highest = speed;
      }
    }
    return highest;
  }

  remove() {
    this.#gone.abort();
    this.#resized.disconnect();
    this.#plot?.destroy();
    this.#plot = null;
    this.#probe.remove();
  }

  #resize() {
    if (!this.#plot) return this.#rebuild();
    const width = this.host.clientWidth;
    if (width > 0 && width !== this.#plot.width)
      this.#plot.setSize({ width, height: this.options.height });
  }

  #rebuild() {
    this.#plot?.destroy();
    this.#plot = null;
    if (this.#curves.length === 0 || this.host.clientWidth === 0) return;
    const { height, range, xWords, xSpace, minTop, top, read, select } = this.options;
    const colour = (/** @type {string} */ name) => this.resolved(name);
    this.#plot = new uPlot(
      {
        width: this.host.clientWidth,
        height,
        legend: { show: false },
        padding: [8, 12, 0, 0],
        cursor: {
          y: false,
          points: { show: false },
          drag: { x: select !== undefined, y: false, setScale: false, dist: 4 },
          bind: { dblclick: () => this.#doubleClicked() },
        },
        hooks: {
          ready: [touchAsMouse],
          setCursor: [(plot) => read(pointerTime(plot))],
          setSelect: [(plot) => this.#selected(plot)],
          draw: [(plot) => drawMarks(plot, this.#marks, colour)],
        },
        scales: {
          x: { time: false, range },
          y: { range: () => [0, Math.max(minTop, (top?.() ?? this.highest()) * HEADROOM)] },
        },
        axes: [
          {
            ...axis(colour, xWords, xSpace),
            size: 32,
            ticks: { stroke: colour("--grid"), width: 1, size: 8 },
          },
          { ...axis(colour, String, 36), size: 44 },
        ],
        series: [{}, ...this.#curves.flatMap((curve) => seriesOf(curve, colour))],
        bands: bandsOf(this.#curves, colour),
      },
      joined(this.#curves),
      this.host,
    );
  }

  /** @param {uPlot} plot */
  #selected(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.options.select?.(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
  }

  #doubleClicked() {
    return () => {
      this.options.all?.();
      return null;
    };
  }

  /** A colour of tokens.css as the canvas understands it. @param {string} name */
  resolved(name) {
    this.#probe.style.color = `var(${name})`;
    return getComputedStyle(this.#probe).color;
  }
}

/** @param {uPlot} plot @returns {number | null} the time at its pointer */
function pointerTime(plot) {
  const { left } = plot.cursor;
  return left === undefined || left < 0 ? null : plot.posToVal(left, "x");
}

/** Let a finger drag like a mouse; vertically it still scrolls the page. @param {uPlot} plot */
function touchAsMouse(plot) {
  plot.over.style.touchAction = "pan-y";
  for (const [type, as] of [
    ["pointerdown", "mousedown"],
    ["pointermove", "mousemove"],
    ["pointerup", "mouseup"],
    ["pointercancel", "mouseup"],
  ]) {
    plot.over.addEventListener(String(type), (event) => {
      if (!(event instanceof PointerEvent) || event.pointerType === "mouse") return;
      const { clientX, clientY } = event;
      // While dragging, uPlot ignores moves of zero distance.
      plot.over.dispatchEvent(
        new MouseEvent(String(as), { clientX, clientY, movementX: 1, button: 0, bubbles: true }),
      );
    });
  }
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
    values: (/** @type {unknown} */ _plot, /** @type {number[]} */ splits) =>
      splits.map((value) => words(Number(value.toFixed(6)))),
  };
}

/**
 * @param {Curve} curve
 * @param {(name: string) => string} colour
 */
function seriesOf({ kind, label, colour: name, banded }, colour) {
  const stroke = colour(name);
  const points = { show: false };
  if (kind !== "estimate" && kind !== "stray")
    return [{ label, stroke, width: 1.5, dash: DASHES[kind] ?? [], points }];
  const main = {
    label,
    stroke,
    width: kind === "stray" ? 1 : 2,
    points: { show: true, size: 3, width: 0, filter: isolatedSamples },
  };
  if (!banded) return [main];
  const side = { stroke: "transparent", width: 0, points };
  return [{ ...side, label: `${label}, upper` }, { ...side, label: `${label}, lower` }, main];
}

/**
 * Return the samples between two gaps: only these are drawn as dots, the others form a line.
 *
 * @param {uPlot} plot
 * @param {number} index of the series
 * @returns {number[]}
 */
function isolatedSamples(plot, index) {
  const values = plot.data[index] ?? [];
  const found = [];
  let alone = true;
  let last = -1;
  for (let i = 0; i <= values.length; i += 1) {
    const value = i < values.length ? values[i] : null;
    if (value === undefined) continue;
    if (typeof value === "number") {
      if (last >= 0) alone = false;
      last = i;
    } else {
      if (last >= 0 && alone) found.push(last);
      alone = true;
      last = -1;
    }
  }
  return found;
}

/**
 * @param {Curve[]} curves
 * @param {(name: string) => string} colour
 */
function bandsOf(curves, colour) {
  let next = 1;
  return curves.flatMap((curve) => {
    const upper = next;
    next += curve.banded ? 3 : 1;
    if (!curve.banded) return [];
    /** @type {[number, number]} */
    const series = [upper, upper + 1];
    return [{ series, fill: `color-mix(in srgb, ${colour(curve.colour)} 22%, transparent)` }];
  });
}

/**
 * @param {uPlot} plot
 * @param {Marks} marks
 * @param {(name: string) => string} colour
 */
function drawMarks({ ctx, bbox, valToPos }, { starts, changes, segments, gaps }, colour) {
  const dpr = devicePixelRatio;
  const { left, top, width, height } = bbox;
  const seen = (/** @type {number} */ x) => x >= left && x <= left + width;
  ctx.save();
  ctx.font = `${LABEL_PX * dpr}px sans-serif`;
  ctx.textAlign = "left";
  ctx.textBaseline = "alphabetic";
  ctx.lineJoin = "round";
  // An outline in the background colour keeps words legible over curves.
  const write = (/** @type {string} */ words, /** @type {number} */ x, /** @type {number} */ y) => {
    ctx.lineWidth = 3 * dpr;
    ctx.strokeStyle = colour("--surface");
    ctx.setLineDash([]);
    ctx.strokeText(words, x, y);
    ctx.fillText(words, x, y);
  };

  ctx.fillStyle = colour("--warn");
  for (const { begin, end } of gaps) {
    const from = Math.max(left, valToPos(begin, "x", true));
    const to = Math.min(left + width, valToPos(end, "x", true));
    if (to > from)
      ctx.fillRect(from, top + height + dpr, Math.max(to - from, dpr), GAP_BAR_PX * dpr);
  }

  const line = (/** @type {number} */ x, /** @type {number[]} */ dashes) => {
    ctx.lineWidth = dpr;
    ctx.setLineDash(dashes.map((length) => length * dpr));
    ctx.beginPath();
    ctx.moveTo(x, top);
    ctx.lineTo(x, top + height);
    ctx.stroke();
  };
  ctx.strokeStyle = colour("--text");
  for (const { time } of segments) {
    const x = Math.round(valToPos(time, "x", true));
    if (seen(x)) line(x, [1, 3]);
  }

  // Where the label of each row of labels ends.
  const rows = new Array(LABEL_ROWS).fill(-Infinity);
  for (const { time, words, colour: name } of changes) {
    const x = Math.round(valToPos(time, "x", true));
    if (!seen(x)) continue;
    ctx.strokeStyle = ctx.fillStyle = colour(name);
    line(x, [3, 3]);
    const row = rows.findIndex((end) => end < x);
    if (row < 0) continue;
    write(words, x + 3 * dpr, top + (row + 1) * (LABEL_PX + 1) * dpr);
    rows[row] = x + ctx.measureText(words).width + 8 * dpr;
  }

  let labelled = -Infinity;
  for (const { time, speed, words, colour: name } of starts) {
    const x = valToPos(time, "x", true);
    const y = valToPos(speed, "y", true);
    if (!seen(x) || y < top) continue;
    ctx.fillStyle = colour(name);
    ctx.beginPath();
    ctx.arc(x, y, 2.5 * dpr, 0, 2 * Math.PI);
    ctx.fill();
    if (x - labelled < LABEL_SPACE_PX * dpr) continue;
    write(words, x + 4 * dpr, Math.max(y - 5 * dpr, top + LABEL_PX * dpr));
    labelled = x;
  }
  ctx.restore();
}
