/** Tables and charts of a calibration's report, shown while and after it is made. */

import { h, svg, table, tableRow } from "../elements/dom.js";
import { fixed, half95 } from "../elements/words.js";

/** @import * as contract from "../contract" */

/** @typedef {contract.Calibration & {report: Record<string, any> | null}} Calibration */
/** @typedef {{speed_mps: number, delay_s: number} | null} Detectable */
/** @typedef {{distance_m: number, depth_m: number, depth_share: number, across: Detectable, towards: Detectable}} VerdictRow */
/** @typedef {{name: string, used: boolean, reason: string | null, left_px: number | null, right_px: number | null}} ViewError */

const BAR_PX = 7;
const HEIGHT = 96;

/** @param {{rows: VerdictRow[], frame_rate: number}} verdict */
export function verdictTable({ rows, frame_rate }) {
  return table(
    "verdict-table",
    ["Range", "Depth, 95 % interval", "Slowest crossing", "Slowest approaching"],
    rows.map((row) =>
      tableRow(
        `${fixed(row.distance_m, 0)}\u00a0m`,
        `± ${length(half95(row.depth_m))} (${fixed(100 * half95(row.depth_share), 1)} %)`,
        detectable(row.across),
        detectable(row.towards),
      ),
    ),
    `Speeds are the slowest detectable for a person-sized object at ${fixed(frame_rate, 0)} fps.`,
  );
}

/**
 * A pair of bars for each view, left and right image; views not used look different.
 *
 * @param {ViewError[]} views
 */
export function viewChart(views) {
  const used = views.flatMap(({ used, left_px, right_px }) =>
    used ? [left_px ?? 0, right_px ?? 0] : [],
  );
  // Views not used may be far off, which would make all others look alike.
  const most = Math.max(0.3, 1.3 * Math.max(0, ...used));
  const step = 2 * BAR_PX + 6;
  const largest = fixed(Math.max(0, ...used), 2);
  const chart = svg("svg", {
    viewBox: `0 0 ${Math.max(views.length * step, 10 * step)} ${HEIGHT + 14}`,
    class: "view-chart",
    role: "img",
    "aria-label": `Reprojection error of ${views.length} views; largest among the used views ${largest} px`,
  });
  for (const [place, view] of views.entries()) {
    const errors = `left ${fixed(view.left_px, 2)} px, right ${fixed(view.right_px, 2)} px`;
    const out = view.used ? "" : `; not used: ${view.reason ?? ""}`;
    const bars = [view.left_px, view.right_px].map((px, side) => {
      const height = Math.min(1, (px ?? 0) / most) * HEIGHT;
      return svg("rect", {
        x: place * step + side * (BAR_PX + 1),
        y: HEIGHT - height,
        width: BAR_PX,
        height,
        class: side === 0 ? "left" : "right",
      });
    });
    chart.append(
      svg(
        "g",
        { class: view.used ? null : "refused" },
        svg("title", {}, `View ${view.name}: ${errors}${out}`),
        ...bars,
        svg(
          "text",
          { x: place * step + BAR_PX, y: HEIGHT + 11, "text-anchor": "middle" },
          view.name.slice(0, 4),
        ),
      ),
    );
  }
  chart.append(svg("line", { x1: 0, x2: "100%", y1: HEIGHT, y2: HEIGHT }));
  // The numbers must stay legible: on a phone the chart scrolls.
  chart.style.minWidth = `${Math.max(views.length, 10) * step * 0.8}px`;
  const caption = h(
    "figcaption.hint",
    h("span.chart-key.left"),
    "Left and ",
    h("span.chart-key.right"),
    `right image of each view. Full height: ${fixed(most, 2)} px.`,
  );
  return h("figure", h("div.scroll-x", chart), caption);
}

/** @param {number} metres */
function length(metres) {
  return metres < 0.1 ? `${fixed(1000 * metres, 0)} mm` : `${fixed(100 * metres, 0)} cm`;
}

/** @param {Detectable} found */
function detectable(found) {
  return found
    ? `${fixed(found.speed_mps, 2)} m/s after ${fixed(found.delay_s, 1)} s`
    : "not detectable in time";
}
