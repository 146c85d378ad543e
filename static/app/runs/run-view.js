/** One run: its frames, its speeds against ground truth, its facts and exports. */

import {
  button,
  details,
  h,
  icon,
  setAttribute,
  setText,
  table,
  tableRow,
} from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { duration, sentence } from "../elements/words.js";
import { valueInWords } from "../parameters/value-words.js";
import { ApiError, request } from "../shell/api.js";
import { attemptIn, notify } from "../shell/notice.js";
import { AlignmentPanel } from "./alignment-panel.js";
import { BackToSource } from "./back-to-source.js";
import { RerunForm } from "./rerun-form.js";
import { RerunProgress } from "./rerun-progress.js";
import { RunChart } from "./run-chart.js";
import { RunExport } from "./run-export.js";
import { RunGoal } from "./run-goal.js";
import { RunLabels } from "./run-labels.js";
import { RunPlayer } from "./run-player.js";
import { removeRun } from "./run-search.js";
import {
  calibrationInWords,
  compareHref,
  facts,
  hasImages,
  isEmpty,
  RECORDING_CHOICES,
} from "./run-words.js";

/** @import { Calibration, Run, RunChart as Chart } from "../contract" */
/** @import { ParameterEntry, Values } from "../parameters/parameter-store.js" */

const RETRY_MS = 5000;
// Frames played before the one opened in 3D.
const LEAD = 15;

export class RunView extends Part {
  /** Called with the title of the view. @type {(words: string) => void} */
  named = () => {};
  /** Called to go back to the live parts. @type {() => void} */
  left = () => {};

  #facts = h("p.hint");
  #state = h("span.state-chip");
  #reason = h("p");
  #original = h("a", "Compare with the original run");
  #play = button([icon("play"), "Open in 3D"], () => this.#open(), {
    "aria-describedby": "open-in-3d-help",
  });
  #playHelp = h("p.hint", { id: "open-in-3d-help" });
  #back = new BackToSource();
  #remove = button([icon("trash"), "Delete run"], () => this.#delete(), { "data-changing": true });
  #error = h("p.field-error", { role: "alert" });
  #waiting = h("p.empty", { role: "status" });
  #player = new RunPlayer();
  #progress = new RerunProgress();
  #chart = new RunChart({ alone: false });
  #goal = new RunGoal();
  #labels = new RunLabels();
  #truth = new AlignmentPanel();
  #rerun = new RerunForm();
  #files = new RunExport(() => this.#chart.offers());
  /** Actions for the run, for the head of the page. */
  actions = h("div.row.run-actions", { hidden: true }, this.#files, this.#remove);
  #again = h("div.stack", this.#truth, this.#rerun);
  #settings = h("div.stack");
  #body = h("div.run-view", { hidden: true });
  /** @type {string | null} */
  #id = null;
  /** @type {Run | null} */
  #run = null;
  /** ID of the run whose curves are shown. @type {string | null} */
  #shown = null;
  #asked = 0;
  #timer = 0;
  /** @type {string | null} */
  #running = null;

  build() {
    this.#body.append(
      this.#files.message,
      h("div.run-head", this.#state, this.#reason),
      this.#player,
      this.#goal,
      h("div.run-head", this.#facts, this.#original),
      h("div.row", this.#play, this.#playHelp),
      this.#back,
      this.#progress,
      this.#waiting,
      this.#chart,
      h("div.run-columns", this.#again, h("div.stack", this.#labels, this.#settings)),
    );
    this.append(this.#error, this.#body);
    const parts = [this.#labels, this.#truth, this.#rerun, this.#files, this.#player];
    for (const part of [...parts, this.#back, this.#progress]) part.attach(this.hub);
    this.#labels.changed = (run) => this.#takeRun(run);
    this.#truth.aligned = () => void this.#load();
    this.#player.moved = (time) => this.#chart.mark(time);
    this.#player.shown = (entry, had) => this.#goal.show(entry, had);
    this.#chart.pointed = (time) => this.#player.seek(time);
    this.#progress.ended = (run) => {
      if (run) void this.#load();
      else location.hash = "#runs";
    };
    this.listen("reconnected", () => this.#load());
    this.listen("status", () => {
      this.#renderPlay();
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
    this.actions.hidden = id === null;
    // Pending answers must not bring the run's actions back.
    this.#asked += 1;
    if (id === null) return this.#player.show(null);
    if (id !== this.#run?.id) this.#body.hidden = this.actions.hidden = true;
    else if (this.#run) this.#player.show(this.#run);
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
      if (isEmpty(run)) return setText(this.#waiting, "");
      if (this.#shown !== id) setText(this.#waiting, "Reading the speeds from the recording…");
      /** @type {Chart} */
      const chart = await request("GET", `${path}/chart`);
      if (asked !== this.#asked) return;
      this.#shown = id;
      setText(this.#waiting, "");
      this.#takeRun(chart.run);
      this.#chart.show([chart]);
      this.#truth.show(chart);
      setText(this.#error, "");
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (asked !== this.#asked) return;
      setText(this.#waiting, "");
      setText(this.#error, error.message);
    }
    if (this.#run?.id === id && this.#run.state === "running")
      this.#timer = setTimeout(() => void this.#load(), RETRY_MS);
  }

  /** @param {Run} run */
  #takeRun(run) {
    const other = run.id !== this.#run?.id;
    this.#run = run;
    if (other) {
      this.#shown = null;
      this.#chart.show([]);
      this.#chart.mark(null);
      this.#truth.forget();
    }
    this.#body.hidden = this.actions.hidden = false;
    this.named(run.name);
    setText(this.#state, run.state);
    this.#state.dataset.state = run.state;
    this.#state.hidden = run.state === "finished";
    setText(this.#facts, facts(run));
    setText(this.#reason, run.reason ? sentence(run.reason) : "");
    this.#reason.hidden = !run.reason;
    this.#original.hidden = run.rerun_of === null;
    if (run.rerun_of) this.#original.setAttribute("href", compareHref([run.rerun_of, run.id]));
    const again = run.state === "running" && run.rerun_of !== null;
    this.#progress.watch(again ? run : null);
    this.#remove.disabled = run.state === "running";
    const empty = isEmpty(run);
    this.#chart.hidden = this.#again.hidden = this.#files.hidden = empty;
    this.#playHelp.hidden = this.#play.hidden = empty || !hasImages(run);
    this.#renderPlay();
    this.#player.show(run);
    this.#labels.show(run);
    this.#rerun.show(run);
    this.#files.show(run);
    if (other) void this.#showSettings(run);
  }

  /** @param {Run} run */
  async #showSettings(run) {
    this.#settings.replaceChildren();
    /** @type {[Calibration[], ParameterEntry[]]} */
    const [library, schema] = await Promise.all([
      request("GET", "/calibrations").catch(() => []),
      request("GET", "/parameters/schema").catch(() => []),
    ]);
    if (run.id === this.#run?.id) this.#settings.replaceChildren(settingsOf(run, library, schema));
  }

  #renderPlay() {
    const source = this.hub.status?.source ?? null;
    const back = source && !source.before ? `; a button then returns to ${source.name}` : "";
    setText(this.#playHelp, `Replaces the live source${back}.`);
  }

  /** Open the recording as a source at the frame shown. */
  async #open() {
    const run = this.#run;
    if (!run || this.#play.getAttribute("aria-disabled")) return;
    setAttribute(this.#play, "aria-disabled", "true");
    const seek = this.#player.position;
    await attemptIn(this.#error, async () => {
      this.hub.applyStatus(await request("PUT", "/source", { source: `run:${run.id}` }));
      // Tracks need some frames to start.
      const lead = Math.min(seek, LEAD);
      await request("POST", "/playback", { paused: true, seek: seek - lead });
      if (lead > 0) await request("POST", "/playback", { step: lead });
      notify(`Playing the recording of ${run.name}.`);
      this.left();
    });
    setAttribute(this.#play, "aria-disabled", null);
  }

  async #delete() {
    if (this.#run && (await removeRun(this.hub, this.#run))) location.hash = "#runs";
  }
}

/**
 * @param {Run} run
 * @param {Calibration[]} library
 * @param {ParameterEntry[]} schema
 */
function settingsOf(run, library, schema) {
  const { preset, calibration_id: calibration, record, versions } = run;
  const parameters = /** @type {Values} */ (run.parameters);
  const recorded = RECORDING_CHOICES.find(([choice]) => choice === record)?.[1];
  /** @type {[string, string][]} */
  const lines = [
    ["Run ID", run.id],
    ["Source", run.source],
    ["Duration", duration(run.duration_s)],
    ["Preset", preset ?? "custom values"],
    ["Calibration", calibrationInWords(calibration, run.source, library)],
    ["Recorded images", recorded ?? "No recording"],
    ...Object.entries(versions),
  ];
  const known = schema.filter(({ name }) => name in parameters);
  return details(
    "Run settings",
    table(
      "settings",
      [],
      lines.map(([name, words]) => tableRow(name, words)),
    ),
    table(
      "settings",
      [],
      known.map((entry) => tableRow(entry.title, valueInWords(parameters[entry.name], entry))),
      "Parameters",
    ),
  );
}

customElements.define("observer-run", RunView);
