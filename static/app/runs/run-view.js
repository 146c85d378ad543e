/** One run: its speeds against truth, what is known of it, and what can be made of it. */

import { button, details, h, icon, setText, table, tableRow } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { sentence } from "../elements/words.js";
import { ApiError, request } from "../shell/api.js";
import { attempt, notify } from "../shell/notice.js";
import { AlignmentPanel } from "./alignment-panel.js";
import { RerunForm } from "./rerun-form.js";
import { RunChart } from "./run-chart.js";
import { RunFiles } from "./run-files.js";
import { RunLabels } from "./run-labels.js";
import { removeRun } from "./run-search.js";
import { compareHref, facts, hasImages } from "./run-words.js";

/** @import { Run, RunChart as Chart } from "../contract" */

const AGAIN_MS = 5000;

export class RunView extends Part {
  /** Called with what the view is to be called. @type {(words: string) => void} */
  named = () => {};
  /** Called when the live parts are wanted. @type {() => void} */
  left = () => {};

  #facts = h("p.hint");
  #state = h("span.state-chip");
  #reason = h("p.hint");
  #original = h("a", "Compare with the original run");
  #play = button([icon("play"), "Play recording"], () => this.#open());
  #remove = button([icon("trash"), "Delete run"], () => this.#delete());
  #error = h("p.field-error", { role: "alert" });
  #waiting = h("p.empty", { role: "status" });
  #chart = new RunChart();
  #labels = new RunLabels();
  #truth = new AlignmentPanel();
  #rerun = new RerunForm();
  #files = new RunFiles();
  #settings = h("div.stack");
  #body = h("div.run-view", { hidden: true });
  /** @type {string | null} */
  #id = null;
  /** @type {Run | null} */
  #run = null;
  /** Whose curves are shown. @type {string | null} */
  #shown = null;
  #asked = 0;
  #timer = 0;
  /** @type {string | null} */
  #running = null;

  build() {
    const head = h(
      "div.run-head",
      this.#state,
      this.#facts,
      this.#original,
      h("div.row", this.#play, this.#remove),
    );
    this.#body.append(
      head,
      this.#reason,
      this.#waiting,
      this.#chart,
      h(
        "div.run-columns",
        h("div.stack", this.#truth, this.#files),
        h("div.stack", this.#labels, this.#rerun, this.#settings),
      ),
    );
    this.append(this.#error, this.#body);
    for (const part of [this.#labels, this.#truth, this.#rerun, this.#files]) part.attach(this.hub);
    this.#labels.changed = (run) => this.#takeRun(run);
    this.#truth.aligned = () => void this.#load();
    this.hear("reconnected", () => this.#load());
    this.hear("status", () => {
      const id = this.hub.status?.run?.id ?? null;
      const ended = this.#running === this.#id && id !== this.#id;
      this.#running = id;
      if (ended) void this.#load();
    });
  }

  /** @param {string | null} id null: another view is shown */
  show(id) {
    this.hidden = id === null;
    clearTimeout(this.#timer);
    this.#id = id;
    if (id === null) return;
    if (id !== this.#run?.id) this.#body.hidden = true;
    setText(this.#error, "");
    void this.#load();
  }

  async #load() {
    const id = this.#id;
    if (id === null) return;
    const asked = ++this.#asked;
    clearTimeout(this.#timer);
    const path = `/runs/${encodeURIComponent(id)}`;
    try {
      /** @type {Run} */
      const run = await request("GET", path);
      if (asked !== this.#asked) return;
      this.#takeRun(run);
      if (this.#shown !== id) setText(this.#waiting, "Reading the speeds from the recording…");
      /** @type {Chart} */
      const chart = await request("GET", `${path}/chart`);
      if (asked !== this.#asked) return;
      this.#shown = id;
      setText(this.#waiting, "");
      this.#takeRun(chart.run);
      this.#chart.show([chart]);
      this.#truth.show(chart);
      if (chart.run.state === "running")
        this.#timer = setTimeout(() => void this.#load(), AGAIN_MS);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (asked !== this.#asked) return;
      setText(this.#waiting, "");
      setText(this.#error, error.message);
    }
  }

  /** @param {Run} run */
  #takeRun(run) {
    const other = run.id !== this.#run?.id;
    this.#run = run;
    if (other) {
      this.#shown = null;
      this.#chart.show([]);
      this.#truth.forget();
    }
    this.#body.hidden = false;
    this.named(`Run ${run.name}`);
    setText(this.#state, run.state);
    this.#state.dataset.state = run.state;
    setText(this.#facts, facts(run));
    setText(this.#reason, run.reason ? sentence(run.reason) : "");
    this.#reason.hidden = !run.reason;
    this.#original.hidden = run.rerun_of === null;
    if (run.rerun_of) this.#original.setAttribute("href", compareHref([run.rerun_of, run.id]));
    this.#remove.disabled = run.state === "running";
    this.#play.hidden = !hasImages(run);
    this.#labels.show(run);
    this.#rerun.show(run);
    this.#files.show(run);
    if (other) this.#settings.replaceChildren(settingsOf(run));
  }

  /** Open the recording as a source, with a slider for every frame. */
  async #open() {
    const run = this.#run;
    if (!run || this.#play.getAttribute("aria-disabled")) return;
    this.#play.setAttribute("aria-disabled", "true");
    await attempt(async () => {
      this.hub.takeStatus(await request("PUT", "/source", { source: `run:${run.id}` }));
      notify(`Playing the recording of ${run.name}.`);
      this.left();
    });
    this.#play.removeAttribute("aria-disabled");
  }

  async #delete() {
    if (this.#run && (await removeRun(this.hub, this.#run))) location.hash = "#history";
  }
}

/** @param {Run} run with what it was observed */
function settingsOf(run) {
  const { preset, calibration_id: calibration, record, versions, parameters } = run;
  /** @type {[string, string][]} */
  const lines = [
    ["Preset", preset ?? "custom values"],
    ["Calibration", calibration ? calibration.slice(0, 12) : "the source's own"],
    ["Recorded images", record ?? "no recording"],
    ...Object.entries(versions),
  ];
  const listed = (/** @type {[string, unknown][]} */ rows) =>
    table(
      "settings",
      [],
      rows.map(([name, value]) => tableRow(name, String(value))),
    );
  return details("Run settings", listed(lines), listed(Object.entries(parameters)));
}

customElements.define("observer-run", RunView);
