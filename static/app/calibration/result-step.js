/** The third step: the result, how good it is, and saving it. */

import { button, field, fillList, h, input, onSubmit, setText } from "../elements/dom.js";
import { fillFigures } from "../elements/figure-list.js";
import { moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { counted, fixed } from "../elements/words.js";
import { request } from "../shell/api.js";
import { attempt, attemptIn, notify, exclusiveRunner } from "../shell/notice.js";
import { paintPreview } from "./calibration-preview.js";
import { verdictTable, viewChart } from "./report-parts.js";

/** @import { Calibration } from "./report-parts.js" */

const RETRY_MS = 5000;

export class ResultStep extends Part {
  /** Called to capture more views. */
  again = () => {};
  /** Called to compute again from the remaining views. */
  compute = () => {};
  /** Called once the calibration is saved and in use. */
  saved = () => {};

  #unread = h("p.field-error", { role: "alert" });
  #sentence = h("p.verdict.big", { role: "status" });
  #warnings = h("ul.plain-list.warnings");
  #verdict = h("div");
  #figures = h("dl.figures");
  #chart = h("div");
  #refused = h("ul.plain-list");
  #canvas = h("canvas", {
    width: 4,
    height: 1,
    role: "img",
    "aria-label": "Rectified pair, left and right, with horizontal lines across both",
  });
  #rows = h("p.verdict", { role: "status" });
  #name = input("text", "result-name", { maxlength: 100, required: true });
  #error = h("p.field-error", { role: "alert" });
  #use = h("button.button.primary", { type: "submit" }, "Save and use");
  #keep = button("Save without using", () => this.#save(false));
  #again = button("Capture more", () => this.again());
  #recompute = button("Recompute", () => this.compute(), { hidden: true });
  #refresh = button("Load newest pair", () => this.#paint());
  #rectified = h(
    "div.stack",
    h("h3", "Rectified"),
    this.#canvas,
    h(
      "p.hint",
      "A point in the left image must lie on the same horizontal line in the right image.",
    ),
    this.#rows,
    h("div.row", this.#refresh),
  );
  #do = exclusiveRunner(undefined, this.#error);
  #shown = false;
  #read = "";
  #timer = 0;
  /** @type {Record<string, any> | null} */
  #report = null;

  build() {
    const form = h(
      "form.stack",
      field("Name", this.#name),
      this.#error,
      h("div.row", this.#use, this.#keep, this.#again),
    );
    this.append(
      this.#unread,
      this.#sentence,
      this.#warnings,
      h(
        "div.result-columns",
        h("div.stack", h("h3", "Expected accuracy"), this.#verdict, this.#figures),
        h(
          "div.stack",
          h("h3", "Error per view"),
          this.#chart,
          this.#refused,
          h("div.row", this.#recompute),
        ),
      ),
      this.#rectified,
      h("h3", "Save calibration"),
      form,
    );
    onSubmit(form, () => this.#save(true));
    this.listen("status", () => this.#load());
  }

  /** @param {boolean} shown whether this step is visible */
  show(shown) {
    this.hidden = !shown;
    this.#shown = shown;
    if (shown) void this.#load();
  }

  /** Show a new result, even if it is based on the same views. */
  renew() {
    this.#read = "";
  }

  async #load() {
    const now = this.hub.status?.calibrating;
    const names = now?.result?.join("|") ?? "";
    const same = !now || names === now.views.map((view) => view.name).join("|");
    if (same) moveFocus(this.#recompute, this.#again);
    this.#recompute.hidden = same || !now.views.length;
    if (!same) setText(this.#recompute, `Recompute with ${counted(now.views.length, "view")}`);
    if (!this.#shown || !names || names === this.#read) return;
    this.#read = names;
    clearTimeout(this.#timer);
    const done = await attemptIn(this.#unread, async () => {
      const { report } = /** @type {{report: Record<string, any>}} */ (
        await request("GET", "/calibrating/result")
      );
      if (!this.#name.value) this.#name.value = suggestedName(now?.source ?? null);
      this.#show(report, new Set(now?.views.map((view) => view.name)));
      void this.#paint();
    });
    if (done) return;
    // Do not try again on every status.
    this.#timer = setTimeout(() => {
      this.#read = "";
      void this.#load();
    }, RETRY_MS);
  }

  /** @param {Record<string, any>} report @param {Set<string>} present names of views that still exist */
  #show(report, present) {
    const { verdict, held_out: heldOut, interval_95: half } = report;
    this.#report = report;
    this.#sentence.dataset.tone = verdict?.warnings.length ? "poor" : "good";
    setText(this.#sentence, verdict?.sentence ?? "");
    fillList(this.#warnings, verdict?.warnings ?? []);
    this.#verdict.replaceChildren(verdict ? verdictTable(verdict) : "");
    const [wide, high] = report.field_of_view_deg;
    fillFigures(this.#figures, [
      ["Stereo error, RMS", `${fixed(report.rms_stereo_px, 2)} px`],
      [
        "Left / right error, RMS",
        `${fixed(report.rms_left_px, 2)} / ${fixed(report.rms_right_px, 2)} px`,
      ],
      [
        "Epipolar error, held-out views",
        heldOut
          ? `${fixed(heldOut.median_px, 2)} px, 95 % ≤ ${fixed(heldOut.p95_px, 2)} px`
          : "too few views",
      ],
      [
        "Baseline, 95 % interval",
        `${fixed(report.baseline_m * 1000, 2)} ± ${fixed(half.baseline_m * 1000, 2)} mm`,
      ],
      ["Field of view", `${fixed(wide, 1)}° × ${fixed(high, 1)}°`],
      [
        "Focal length, 95 % interval",
        `${fixed(report.focal_px[0], 1)} ± ${fixed(half.focal_left_px, 1)} px`,
      ],
      ["Vergence, 95 % interval", `± ${fixed(half.vergence_deg, 3)}°`],
      ["Views", `${report.pairs} pairs`],
    ]);
    this.#chart.replaceChildren(viewChart(report.views));
    const bad = report.views.filter((/** @type {{used: boolean}} */ view) => !view.used);
    this.#refused.replaceChildren(
      ...bad.map((/** @type {{name: string, reason: string}} */ view) =>
        this.#badView(view, present),
      ),
    );
  }

  /** @param {{name: string, reason: string | null}} view @param {Set<string>} present */
  #badView(view, present) {
    const remove = button(`Remove view ${view.name}`, async () => {
      await attempt(async () => {
        await request("PATCH", "/calibrating", { remove: view.name });
        moveFocus(remove, this.#again);
        remove.replaceWith("Removed");
      });
    });
    return h(
      "li.row",
      h("span", `View ${view.name} not used: ${view.reason ?? "it does not fit"}.`),
      present.has(view.name) ? remove : null,
    );
  }

  async #paint() {
    const live = this.hub.status?.calibrating?.source !== null;
    this.#rectified.hidden = false;
    setText(this.#again, live ? "Capture more" : "Back to the views");
    await paintPreview("/calibrating/preview", this.#canvas, this.#rows, this.#report);
    // Uploaded images need not come from the open cameras.
    if (!live && this.#canvas.hidden) this.#rectified.hidden = true;
  }

  /** @param {boolean} activate */
  async #save(activate) {
    const button = activate ? this.#use : this.#keep;
    const save = async () => {
      /** @type {Calibration} */
      const saved = await request("POST", "/calibrating/save", {
        name: this.#name.value.trim(),
        activate,
      });
      notify(
        activate ? `${saved.name} saved and now in use.` : `${saved.name} saved. It is not in use.`,
      );
      this.hub.emit("calibrations");
      if (!activate) return;
      this.#read = this.#name.value = "";
      this.saved();
    };
    await this.#do(save, button, activate ? "Saving and opening…" : "Saving…");
  }
}

/** @param {string | null} source */
function suggestedName(source) {
  const day = new Date().toISOString().slice(0, 10);
  return `${source ?? "Images"}, ${day}`.slice(0, 100);
}

customElements.define("observer-result-step", ResultStep);
