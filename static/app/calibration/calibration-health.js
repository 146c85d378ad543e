/** Ageing of the calibration in use: epipolar error over time, vergence, skew, and refining. */

import { button, h, setAttribute, setText, svg } from "../elements/dom.js";
import { ROW_WARN_PX } from "../elements/facts.js";
import { Part } from "../elements/part.js";
import { fixed, sentence } from "../elements/words.js";
import { request } from "../shell/api.js";
import { notify, exclusiveRunner } from "../shell/notice.js";
import { refinementInWords, skewInWords, trendInWords, warningInWords } from "./ageing-words.js";
import { confirmPreview } from "./calibration-preview.js";

/** @import { Calibration } from "./report-parts.js" */
/** @import { RowDriftStatus } from "../contract" */

const WIDTH = 240;
const HEIGHT = 48;

class CalibrationHealth extends Part {
  #words = h("p.verdict");
  // The number changes constantly, so only warnings are announced.
  #spoken = h("p.visually-hidden", { role: "status" });
  #trend = h("p.hint");
  #chart = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "drift-chart", role: "img" });
  #vergence = h("p.hint");
  #skew = h("p.hint");
  #refines = h("p.hint");
  #refine = button("Refine calibration", () =>
    this.#do(() => this.#refineRows(), this.#refine, "Refining…"),
  );
  #drawn = "";
  #refusal = h("p.field-error", { role: "alert" });
  #do = exclusiveRunner(undefined, this.#refusal);

  build() {
    this.append(
      h("h3", "Calibration health"),
      this.#words,
      this.#spoken,
      this.#chart,
      this.#trend,
      this.#vergence,
      this.#skew,
      this.#refines,
      h("div.row", this.#refine),
      this.#refusal,
    );
    this.listen("status", () => this.#render());
  }

  #render() {
    const ageing = this.hub.status?.ageing ?? null;
    this.hidden = ageing === null;
    if (!ageing) return;
    const { rows, vergence } = ageing;
    const { now_px } = rows;
    this.#words.dataset.tone =
      now_px === null ? "" : rows.warning ? "bad" : now_px < ROW_WARN_PX ? "good" : "poor";
    setText(
      this.#words,
      now_px !== null
        ? `Epipolar error between left and right: ${fixed(now_px, 2)} px (limit ${ROW_WARN_PX} px).`
        : "Point the cameras at a textured scene for a few seconds to measure the epipolar error.",
    );
    setText(this.#trend, rows.warning ? sentence(rows.warning) : trendInWords(rows));
    setText(this.#spoken, warningInWords(ageing));
    setText(this.#vergence, sentence(vergence.sentence));
    setText(this.#skew, skewInWords(ageing));
    setText(this.#refines, refinementInWords(ageing));
    this.#refine.disabled = this.hub.status?.run !== null;
    setAttribute(this.#refine, "title", this.#refine.disabled ? "Stop the run to refine" : null);
    this.#draw(rows);
  }

  /** @param {RowDriftStatus} rows */
  #draw(rows) {
    const history = rows.history;
    this.#chart.toggleAttribute("hidden", history.length < 2);
    const key = JSON.stringify(history.at(-1) ?? null) + history.length;
    if (history.length < 2 || key === this.#drawn) return;
    this.#drawn = key;
    const first = history[0]?.[0] ?? 0;
    const last = history.at(-1)?.[0] ?? 1;
    const most = Math.max(2 * ROW_WARN_PX, ...history.map(([, px]) => px));
    /** @param {number} px */
    const y = (px) => HEIGHT - (px / most) * (HEIGHT - 4) - 2;
    const points = history.map(
      ([time, px]) =>
        `${(((time - first) / Math.max(1, last - first)) * WIDTH).toFixed(1)},${y(px).toFixed(1)}`,
    );
    const limit = y(ROW_WARN_PX);
    this.#chart.replaceChildren(
      svg("line", { x1: 0, x2: WIDTH, y1: limit, y2: limit, class: "allowed" }),
      svg("polyline", { points: points.join(" ") }),
    );
    this.#chart.setAttribute(
      "aria-label",
      `Epipolar error over ${fixed((last - first) / 60, 0)} min, now ${fixed(history.at(-1)?.[1], 2)} px, limit ${ROW_WARN_PX} px`,
    );
  }

  async #refineRows() {
    /** @type {Calibration} */
    const refined = await request("POST", "/calibrations/refine");
    this.hub.emit("calibrations");
    const use = await confirmPreview(refined, false);
    if (!use) return notify(`Saved ${refined.name}. It is not in use.`);
    this.hub.applyStatus(
      await request("POST", `/calibrations/${encodeURIComponent(refined.id)}/activate`),
    );
    notify(`${refined.name} is now in use.`);
    this.hub.emit("calibrations");
  }
}

customElements.define("observer-calibration-health", CalibrationHealth);
