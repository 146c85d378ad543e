/** The table of a run's speed errors, or of several runs side by side. */

import { details, h, swatch, table } from "../elements/dom.js";
import { GLOSSARY } from "../elements/glossary.js";
import { fixed, trackColour } from "../elements/words.js";

/** @import { RunChart, SpeedErrorsEntry } from "../contract" */

const WITHIN = "Within 95 % interval";
const COLUMNS = ["Samples", "Bias, m/s", "RMSE, m/s", "Max. error, m/s", WITHIN, "Measured"];
const EXPLANATION = `The error is the estimated speed minus the ground-truth speed at the same instant, over the whole
  run. “Measured” is the share of time with an estimate while the body moved in view.`;

/** @param {RunChart[]} charts @param {boolean} coloured by run @returns {HTMLElement} */
export function errorSection(charts, coloured) {
  const several = charts.length > 1;
  const known = charts.some((chart) => chart.errors.some(({ samples }) => samples > 0));
  const missing =
    several || charts[0]?.aligned ? "at the times of these speeds" : "to compare with";
  return h(
    "section.chart-errors",
    { "aria-label": "Speed errors" },
    h("h3", "Speed errors"),
    known
      ? h("p.hint", EXPLANATION)
      : h("p.empty", `No speed errors: there is no ground truth ${missing}.`),
    known
      ? several
        ? comparisonTable(charts, coloured)
        : singleRunTables(charts[0] ? charts[0].errors : [])
      : null,
  );
}

/** @param {string[]} more headings @param {HTMLElement[]} rows or bodies of rows */
function errorTable(more, rows) {
  const of = h("span.visually-hidden", "Group");
  const scrolled = { tabindex: 0, role: "group", "aria-label": "Table of speed errors" };
  const columns = COLUMNS.map((name) =>
    name === WITHIN ? h("span", { title: GLOSSARY["coverage"] }, name) : name,
  );
  return table("", [of, ...more, ...columns], rows, undefined, scrolled);
}

/** @param {SpeedErrorsEntry[]} errors */
function singleRunTables(errors) {
  const tracks = errors.filter(({ group }) => group === "track");
  const rows = (/** @type {SpeedErrorsEntry[]} */ some) =>
    some.map((each) =>
      h("tr", h("th", { scope: "row" }, groupInWords(each)), ...cells(each, false)),
    );
  return h(
    "div.stack",
    errorTable([], rows(errors.filter(({ group }) => group !== "track"))),
    tracks.length
      ? details(
          tracks.length === 1 ? "Track details" : `Details of ${tracks.length} tracks`,
          errorTable([], rows(tracks)),
        )
      : null,
  );
}

/**
 * Return a table with each group once and a row for every run, without tracks, which cannot be
 * compared across runs.
 *
 * @param {RunChart[]} charts
 * @param {boolean} coloured
 */
function comparisonTable(charts, coloured) {
  const groups = new Set(
    charts.flatMap((chart) =>
      chart.errors.filter(({ group }) => group !== "track").map(groupInWords),
    ),
  );
  const bodies = [...groups].map((words) => {
    const found = charts.map((chart) =>
      chart.errors.find((each) => each.group !== "track" && groupInWords(each) === words),
    );
    const best = Math.min(...found.map((each) => each?.rmse_mps ?? Infinity));
    return h(
      "tbody",
      ...charts.map(({ run }, at) => {
        const each = found[at];
        return h(
          "tr",
          at === 0 ? h("th", { scope: "rowgroup", rowspan: charts.length }, words) : null,
          h(
            "th",
            { scope: "row" },
            h("span.run-label", coloured ? swatch("estimate", trackColour(at)) : null, run.name),
          ),
          ...(each
            ? cells(each, charts.length > 1 && each.rmse_mps === best)
            : COLUMNS.map(() => h("td", "–"))),
        );
      }),
    );
  });
  return errorTable(["Run"], bodies);
}

/** @param {SpeedErrorsEntry} each @param {boolean} best */
function cells(each, best) {
  const covered = each.coverage === null ? null : `of ${each.covered_of} with a 95 % interval`;
  const number = (/** @type {string} */ words, /** @type {Record<string, unknown>} */ more = {}) =>
    h("td", { ...more }, words);
  return [
    number(String(each.samples)),
    number(fixed(each.bias_mps, 3)),
    number(fixed(each.rmse_mps, 3), {
      "data-best": best,
      title: best ? "Smallest of these runs" : null,
    }),
    number(fixed(each.maximum_mps, 3)),
    number(percent(each.coverage), { title: covered }),
    number(percent(each.seen_share)),
  ];
}

/** @param {number | null} share */
function percent(share) {
  return share === null ? "–" : `${(100 * share).toFixed(0)} %`;
}

/** @param {SpeedErrorsEntry} errors @returns {string} */
function groupInWords({ group, label, body }) {
  if (group === "all") return "Whole run";
  if (group === "direction")
    return label === "at rest" ? "At rest" : `Moving ${directionInWords(label)}`;
  if (group === "way") return `Body moving ${label}`;
  if (group === "track") return body ? `Track ${label} of ${body}` : `Track ${label}, unmatched`;
  return `Body ${label}`;
}

/** @param {string} label */
function directionInWords(label) {
  return label === "left" || label === "right" ? `to the ${label}` : label;
}
