/** Legend of the marks that a speed chart draws in addition to its curves. */

import { GLOSSARY } from "../elements/glossary.js";
import { h, swatch } from "../elements/dom.js";

/** @typedef {"band" | "start" | "change" | "segment" | "gap"} Mark */

/** @type {Record<Mark, {label: string, colour: string, help: string}>} */
export const MARKS = {
  band: { label: "95 % interval", colour: "--track-0", help: GLOSSARY["95 % interval"] },
  start: {
    label: "Start of a track, with its number",
    colour: "--track-0",
    help: GLOSSARY["track"],
  },
  change: { label: "Identity switch", colour: "--muted", help: GLOSSARY["identity switch"] },
  segment: {
    label: "New segment, with new tracks",
    colour: "--text",
    help: GLOSSARY["segment"],
  },
  gap: {
    label: "No ground truth",
    colour: "--warn",
    help: "The ground truth has a gap here: the body was not tracked or not visible.",
  },
};

/**
 * @param {Mark[]} marks that the chart may draw
 * @returns {HTMLElement[]} one element each, for a list or a set of chips
 */
export function markLegend(marks) {
  return marks.map((mark) => {
    const { label, colour, help } = MARKS[mark];
    return h("span.mark-key", { title: help }, swatch(mark, colour), h("span", label));
  });
}
