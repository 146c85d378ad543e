/** CSV, PNG, SVG and PDF of the visible part of a chart: one click opens, the second downloads. */

import { download } from "../elements/dom.js";
import { ExportMenu } from "../elements/export-menu.js";
import { fixed } from "../elements/words.js";
import { requestImage } from "../shell/api.js";
import { attempt } from "../shell/notice.js";

/** @import { MenuGroup } from "../elements/export-menu.js" */

/** @typedef {() => Promise<{blob: Blob, name: string}>} Make */

/**
 * @typedef {object} Offer
 * @property {string} words name what is offered
 * @property {{format: string, title: string, make: Make}[]} files
 */

const FORMATS = {
  csv: "Curves as a CSV table",
  png: "Chart as an image",
  svg: "Vector graphic to edit or embed",
  pdf: "Vector graphic for a paper",
};

/**
 * Return the files that the server offers for a stored run.
 *
 * @param {{id: string, name: string}} run
 * @param {{begin: number, end: number} | null} range seconds on the source's clock; null: all
 * @returns {Offer}
 */
export function runOffer({ id, name }, range) {
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
 * @param {() => Offer[]} offers called when it opens
 */
export function chartMenu(offers) {
  /** @type {ExportMenu} */
  const menu = new ExportMenu(() => chartGroups(offers(), (_, make) => menu.during(save(make))));
  return menu;
}

/**
 * Return the menu groups for the given offers.
 *
 * @param {Offer[]} offers
 * @param {(words: string, make: Make) => unknown} take called with the file's title
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

/** Make and download a file; drawing a figure takes seconds and may fail. @param {Make} make */
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
