/** CSV, PNG, SVG and PDF of what is seen of a chart: one click opens, the second takes. */

import { download } from "../elements/dom.js";
import { ExportMenu } from "../elements/export-menu.js";
import { fixed } from "../elements/words.js";
import { requestImage } from "../shell/api.js";
import { attempt } from "../shell/notice.js";

/** @import { MenuGroup } from "../elements/export-menu.js" */

/** @typedef {() => Promise<{blob: Blob, name: string}>} Make */

/**
 * @typedef {object} Offer
 * @property {string} words of what
 * @property {{format: string, title: string, make: Make}[]} files
 */

const FORMATS = {
  csv: "Curves as a CSV table",
  png: "Chart as an image",
  svg: "Vector graphic to edit or embed",
  pdf: "Vector graphic for a paper",
};

/**
 * Offer the files that the server makes of a stored run.
 *
 * @param {{id: string, name: string}} run
 * @param {{begin: number, end: number} | null} range seconds on the source's clock; null: all
 * @returns {Offer}
 */
export function ofRun({ id, name }, range) {
  const query = range ? `?begin=${range.begin.toFixed(4)}&end=${range.end.toFixed(4)}` : "";
  const words = range ? `${fixed(range.begin, 1)} to ${fixed(range.end, 1)} s` : "whole run";
  return {
    words: `Run “${name}”: ${words}`,
    files: Object.entries(FORMATS).map(([format, title]) => ({
      format,
      title,
      make: async () => {
        const { blob, headers } = await requestImage(
          `/runs/${encodeURIComponent(id)}/chart.${format}${query}`,
        );
        return { blob, name: fileName(headers) ?? `${name}.${format}` };
      },
    })),
  };
}

/**
 * Return the menu of a chart.
 *
 * @param {() => Offer[]} offers asked when it opens
 */
export function chartMenu(offers) {
  /** @type {ExportMenu} */
  const menu = new ExportMenu(() => chartGroups(offers(), (_, make) => menu.during(save(make))));
  return menu;
}

/**
 * What a menu offers of charts.
 *
 * @param {Offer[]} offers
 * @param {(words: string, make: Make) => unknown} take with the words of the file
 * @returns {MenuGroup[]}
 */
export function chartGroups(offers, take) {
  return offers.map(({ words, files }) => ({
    title: words,
    items: files.map(({ format, title, make }) => {
      const name = `Chart, ${format.toUpperCase()}`;
      return { words: name, help: title, take: () => take(name, make) };
    }),
  }));
}

/** Figures take seconds to draw, and may go wrong. @param {Make} make */
function save(make) {
  return attempt(async () => {
    const { blob, name } = await make();
    download(blob, name);
  });
}

/** @param {Headers} headers */
function fileName(headers) {
  return /filename="([^"]+)"/.exec(headers.get("content-disposition") ?? "")?.[1] ?? null;
}
