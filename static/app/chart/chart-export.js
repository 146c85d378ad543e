/** CSV, PNG, SVG and PDF of what is seen of a chart: one click opens, the second takes. */

import { button, download, h, icon } from "../elements/dom.js";
import { fixed } from "../elements/words.js";
import { requestImage } from "../shell/api.js";
import { attempt } from "../shell/notice.js";

/**
 * @typedef {object} Offer
 * @property {string} words of what
 * @property {{format: string, title: string, make: () => Promise<{blob: Blob, name: string}>}[]} files
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
    words: `Run ${name}: ${words}`,
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

export class ChartExport extends HTMLElement {
  #open = button(
    [icon("download"), "Export"],
    () => this.#toggle(this.#box.hidden && !this.#busy),
    { "aria-expanded": "false" },
  );
  #box = h("div.menu-box", {
    role: "group",
    "aria-label": "Export the visible part of the chart",
    hidden: true,
  });
  #offers;
  #busy = false;

  /** @param {() => Offer[]} offers asked when the menu opens */
  constructor(offers = () => []) {
    super();
    this.#offers = offers;
    this.addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || this.#box.hidden) return;
      event.stopPropagation();
      this.#toggle(false);
      this.#open.focus();
    });
    this.addEventListener("focusout", (event) => {
      if (event.relatedTarget instanceof Node && !this.contains(event.relatedTarget))
        this.#toggle(false);
    });
  }

  connectedCallback() {
    this.classList.add("menu");
    if (!this.childElementCount) this.append(this.#open, this.#box);
    document.addEventListener("pointerdown", this.#elsewhere);
  }

  disconnectedCallback() {
    document.removeEventListener("pointerdown", this.#elsewhere);
  }

  #elsewhere = (/** @type {PointerEvent} */ event) => {
    if (event.target instanceof Node && !this.contains(event.target)) this.#toggle(false);
  };

  /** @param {boolean} open */
  #toggle(open) {
    this.#box.hidden = !open;
    this.#open.setAttribute("aria-expanded", String(open));
    if (open) this.#box.replaceChildren(...this.#offers().map((offer) => this.#entry(offer)));
  }

  /** @param {Offer} offer */
  #entry({ words, files }) {
    const buttons = files.map(({ format, title, make }) => {
      const name = format.toUpperCase();
      return button(name, () => this.#save(make), {
        title,
        "aria-label": `${name}. ${words}`,
      });
    });
    return h("div.stack", h("p.hint", words), h("div.row", ...buttons));
  }

  /** @param {Offer["files"][number]["make"]} make */
  async #save(make) {
    this.#toggle(false);
    this.#open.focus();
    // Figures take seconds to draw: meanwhile the page says so, and tells what went wrong.
    this.#work(true);
    await attempt(async () => {
      const { blob, name } = await make();
      download(blob, name);
    });
    this.#work(false);
  }

  /** @param {boolean} busy */
  #work(busy) {
    this.#busy = busy;
    // Not disabled: it has the focus.
    this.#open.setAttribute("aria-disabled", String(busy));
    this.#open.lastChild?.replaceWith(busy ? "Exporting…" : "Export");
  }
}

/** @param {Headers} headers */
function fileName(headers) {
  return /filename="([^"]+)"/.exec(headers.get("content-disposition") ?? "")?.[1] ?? null;
}

customElements.define("observer-chart-export", ChartExport);
