/** Aligning ground truth with a run: which file, how well it fits, which track is which body. */

import {
  button,
  details,
  field,
  fillList,
  h,
  offer,
  setAttribute,
  setText,
} from "../elements/dom.js";
import { fillFigures } from "../elements/figure-list.js";
import { Part } from "../elements/part.js";
import { GLOSSARY } from "../elements/glossary.js";
import { fixed, half95, sentence } from "../elements/words.js";
import { ApiError, request } from "../shell/api.js";
import { CameraOnBody, placeInWords } from "./camera-on-body.js";
import { MatchTable } from "./match-table.js";
import { TruthPicker } from "./truth-picker.js";

/** @import { AlignmentFacts, RunChart, TruthEntry as TruthFile } from "../contract" */

// Ground truth that is on the run's own clock and in its world frame is only added.
const ALIGN = { label: "Align", busy: "Aligning…", done: "Aligned." };
const ADD = { label: "Add to run", busy: "Adding…", done: "Added." };

export class AlignmentPanel extends Part {
  /** Called once a run has been realigned. @type {() => void} */
  aligned = () => {};

  #heading = h("h3", { title: GLOSSARY["ground truth"] }, "Ground truth");
  // Its change announces a new alignment.
  #sentence = h("p", { role: "status" });
  #figures = h("dl.figures");
  #notes = h("ul.plain-list");
  #matches = new MatchTable();
  #picker = new TruthPicker();
  #observer = h("select", { id: "align-observer" });
  #camera = new CameraOnBody();
  #compared = h("div.chips", { role: "group", "aria-label": "Bodies to compare" });
  #bodies = h("div.stack");
  #align = button("Align", () => this.#realign(), {
    class: "button primary",
    title: GLOSSARY["alignment"],
  });
  #state = h("p.hint", { role: "status" });
  #error = h("p.field-error", { role: "alert" });
  #another = details("Add ground truth");
  /** @type {RunChart | null} */
  #chart = null;
  #busy = false;

  build() {
    this.#bodies.append(
      field("Observer body", this.#observer),
      this.#camera,
      h("div.named-part", h("span.field-name", "Bodies to compare"), this.#compared),
    );
    const file = h("div.stack", this.#picker, this.#bodies, h("div.row", this.#align));
    this.#another.append(file);
    this.append(
      this.#heading,
      this.#sentence,
      this.#figures,
      this.#notes,
      this.#matches,
      this.#error,
      this.#state,
      this.#another,
    );
    this.#matches.corrected = (key, body) => void this.#correct(key, body);
    this.#picker.chosen = (chosen) => this.#renderBodies(chosen);
    this.#picker.attach(this.hub);
  }

  /** Clear the panel: another run is shown that has not been loaded yet. */
  forget() {
    this.#chart = null;
    this.hidden = true;
  }

  /** @param {RunChart} chart */
  show(chart) {
    const before = this.#chart;
    const other = chart.run.id !== before?.run.id;
    this.#chart = chart;
    this.hidden = false;
    if (other) {
      setText(this.#error, "");
      setText(this.#state, "");
      this.#another.open = !chart.aligned;
      this.#camera.show(chart.choices?.camera_on_body ?? null);
      void this.#picker.load(chart.run.truth_id ?? (chart.alignment ? "live" : null));
    } else {
      if (!this.#busy) setText(this.#state, "");
      // Keep what is ticked while the chart of a running run is read again.
      if (alignmentOf(chart) !== alignmentOf(before)) this.#renderBodies(this.#picker.file);
    }
    setText(
      this.#sentence,
      sentence(chart.sentence ?? (chart.aligned ? "aligned" : "no ground truth to compare with")),
    );
    setAttribute(this.#sentence, "class", chart.aligned ? "" : "hint");
    const { alignment } = chart;
    this.#camera.found = alignment?.camera_on_body ?? null;
    fillFigures(this.#figures, alignment ? figuresOf(alignment) : []);
    fillList(this.#notes, (alignment?.notes ?? []).map(sentence));
    this.#showMatches();
  }

  #showMatches() {
    this.#matches.show(this.#chart?.alignment ?? null, this.#chart?.curves ?? []);
  }

  /** @param {TruthFile | null} file */
  #renderBodies(file) {
    const { live } = this.#picker;
    const same = live
      ? this.#chart?.run.truth_id === null
      : file !== null && file.id === this.#chart?.run.truth_id;
    const roles = (same && this.#chart?.alignment?.roles) || {};
    const aligned = Object.keys(roles).length > 0;
    const names = live ? Object.keys(roles) : (file?.info.bodies.map(({ name }) => name) ?? []);
    this.#bodies.hidden = names.length === 0;
    if (!this.#busy) setText(this.#align, this.#words.label);
    setAttribute(this.#align, "aria-disabled", file || live ? null : "true");
    const observer = names.find((name) => roles[name] === "observer");
    const choices = names.map((name) => [name, name]);
    offer(this.#observer, [["", "detect from motion"], ...choices], observer);
    this.#compared.replaceChildren(
      ...names.map((name) => {
        const box = h("input", { type: "checkbox", value: name });
        box.checked = !aligned || name in roles;
        return h("label", box, name);
      }),
    );
  }

  /** Correct one match, keeping everything else, including earlier manual choices. */
  async #correct(/** @type {string} */ key, /** @type {string | null} */ body) {
    const { run, alignment, choices } = /** @type {RunChart} */ (this.#chart);
    const said = Object.entries(alignment?.matches ?? {}).flatMap(([each, match]) =>
      match.by === "person" ? [[each, match.body]] : [],
    );
    const roles = alignment?.roles ?? {};
    await this.#ask({
      truth_id: run.truth_id,
      observer: alignment?.observer ?? null,
      expected_offset_s: choices?.expected_offset_s ?? null,
      camera_on_body: choices?.camera_on_body ?? null,
      ignore: (this.#picker.find(run.truth_id)?.info.bodies ?? []).flatMap(({ name }) =>
        name in roles ? [] : [name],
      ),
      matches: { ...Object.fromEntries(said), [key]: body },
    });
  }

  async #realign() {
    const { file, live } = this.#picker;
    if (!file && !live) return this.#refuse("Choose a ground-truth file first.");
    let camera;
    try {
      camera = this.#camera.place;
    } catch (error) {
      return this.#refuse(/** @type {RangeError} */ (error).message);
    }
    const left = /** @type {NodeListOf<HTMLInputElement>} */ (
      this.#compared.querySelectorAll("input:not(:checked)")
    );
    const run = this.#chart?.run.id;
    setText(this.#align, this.#words.busy);
    await this.#ask({
      truth_id: file?.id ?? null,
      observer: this.#observer.value || null,
      ignore: [...left].map(({ value }) => value),
      matches: {},
      camera_on_body: camera,
    });
    setText(this.#align, this.#words.label);
    if (run === this.#chart?.run.id) this.#scrollToResult();
  }

  /** What happens to the file chosen. */
  get #words() {
    return this.#picker.file?.info.bodies.length === 0 ? ADD : ALIGN;
  }

  /** @param {string} why */
  #refuse(why) {
    setText(this.#error, why);
    this.#scrollToResult();
  }

  /** Scroll the result or the error, which are above, into view. */
  #scrollToResult() {
    (this.#error.textContent ? this.#error : this.#heading).scrollIntoView({ block: "nearest" });
  }

  /** Allow one alignment at a time; the controls look disabled meanwhile. @param {boolean} busy */
  #setBusy(busy) {
    this.#busy = busy;
    const possible = !busy && (this.#picker.file !== null || this.#picker.live);
    setAttribute(this.#align, "aria-disabled", possible ? null : "true");
    this.#matches.setBusy(busy);
  }

  /** @param {object} wanted body of POST /api/runs/{id}/align */
  async #ask(wanted) {
    const run = this.#chart?.run;
    if (!run || this.#busy) return this.#showMatches();
    // Another run may be shown by the time of the answer.
    const shown = () => this.#chart?.run.id === run.id;
    this.#setBusy(true);
    setText(this.#error, "");
    const words = this.#words;
    setText(
      this.#state,
      words === ALIGN ? "Aligning: comparing speeds over the whole run…" : words.busy,
    );
    try {
      await request("POST", `/runs/${encodeURIComponent(run.id)}/align`, wanted);
      if (shown()) setText(this.#state, `${words.done} Recomputing the errors…`);
      this.hub.emit("runs");
      if (shown()) this.aligned();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (!shown()) return;
      setText(this.#state, "");
      this.#showMatches();
      const kept = this.#chart?.aligned ? " The previous alignment is kept." : "";
      setText(this.#error, error.message + kept);
    } finally {
      this.#setBusy(false);
    }
  }
}

/** Return everything that the choice of bodies depends on. @param {RunChart} chart */
function alignmentOf({ run, alignment }) {
  return JSON.stringify([run.truth_id, alignment]);
}

/** Return figures for how well it fits. @param {AlignmentFacts} alignment */
function figuresOf({ frame_residual_m: apart, camera_on_body: camera, ...time }) {
  const drift =
    time.drift_sigma_ppm === null
      ? "not determined"
      : `${fixed(time.drift_ppm, 0)} ± ${fixed(half95(time.drift_sigma_ppm), 0)} ppm`;
  /** @type {import("../elements/figure-list.js").Figure[]} */
  const figures = [
    [
      "Time offset",
      `${fixed(1000 * time.offset_s, 1)} ± ${fixed(1000 * half95(time.sigma_s), 1)} ms`,
      GLOSSARY["95 % interval"],
    ],
    ["Clock drift", drift, GLOSSARY["95 % interval"]],
    ["Correlation", fixed(time.correlation, 3)],
    ["Overlap", `${fixed(time.overlap_s, 1)} s`],
    ["Residual", `${fixed(time.residual_mps, 3)} m/s`],
    ["Position residual", apart === null ? "not compared" : `${fixed(apart, 2)} m`],
  ];
  if (camera) figures.push(["Camera on the body", placeInWords(camera)]);
  return figures;
}

customElements.define("observer-alignment", AlignmentPanel);
