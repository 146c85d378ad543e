/** Choice of the source: a field with suggestions, and tiles of the available sources. */

import {
  button,
  field,
  h,
  input,
  offer,
  onSubmit,
  setAttribute,
  setText,
} from "../elements/dom.js";
import { declareKeys } from "../elements/keys.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { attemptIn, notify, showError } from "../shell/notice.js";
import { CameraPicker } from "./camera-picker.js";
import {
  boardOf,
  choiceOfEntry,
  choicesOfCameras,
  choicesOfRuns,
  merged,
  placeholders,
  shortSpec,
  suggestions,
} from "./choices.js";
import { Combobox } from "./combobox.js";
import { LatestRequest } from "../elements/latest-request.js";
import { PictureQueue } from "./picture-queue.js";
import { SourceGroup } from "./source-group.js";

/** @import { Calibration } from "../calibration/report-parts.js" */
/** @import { History, SourceEntry, Status } from "../contract" */
/** @import { Choice } from "./choices.js" */

/**
 * @typedef {object} Pressed the control pressed to open a source
 * @property {HTMLElement} button
 * @property {Element} indicator shows that it is being opened
 * @property {HTMLElement} error shows why it was not
 */

declareKeys(
  "Source field",
  ["↓ ↑", "Go through the suggestions"],
  ["Enter", "Open the selected suggestion, or what you typed"],
  ["Esc", "Close the suggestions"],
);

const MAX_PER_GROUP = 6;
const MAX_RUNS = 50;
// Query the server only once typing pauses.
const SEARCH_AFTER_MS = 200;

class SourcePicker extends Part {
  #spec = input("text", "source-spec", {
    spellcheck: "false",
    autocapitalize: "off",
    required: true,
    "aria-describedby": "source-error source-spec-help",
  });
  /** @type {Combobox<Choice>} */
  #suggested = new Combobox(this.#spec, "Suggested sources", drawn);
  #open = h("button.button.primary", { type: "submit" }, "Open");
  #error = h("p.field-error", { id: "source-error", role: "alert" });
  #openNow = h("span.hint");
  #calibration = h("select", { id: "source-calibration" });
  #inRun = h("p.hint", { hidden: true }, "Stop the run to open another source.");
  #pictures = new PictureQueue();
  #cameras = new CameraPicker();
  /** Moves to the tile pressed. */
  #tileError = h("p.field-error.source-error", { role: "alert" });
  /** Moves below the error that it remedies. */
  #calibrate = button("Calibrate these cameras", () => this.#openWizard(this.#uncalibrated), {
    hidden: true,
  });
  #groups = this.#makeGroups();
  /** Runs shown as tiles. @type {Choice[]} */
  #runs = [];
  /** Runs found by the typed text. @type {Choice[]} */
  #foundRuns = [];
  /** @type {Choice[]} */
  #foundCameras = [];
  #latestSources = new LatestRequest();
  #latestRuns = new LatestRequest();
  #search = new LatestRequest();
  #searchTimer = 0;
  #uncalibrated = "";
  #busy = false;
  /** The open source for which the tiles are shown. */
  #tilesOf = "";
  #followed = "";

  build() {
    const hint =
      "Search by name, or enter simulated:SCENARIO, camera:0,1, rtsp://LEFT,rtsp://RIGHT, video:LEFT,RIGHT, coppeliasim:HOST:PORT, or a path on the server.";
    const form = h(
      "form.stack",
      { novalidate: true },
      h(
        "div.field",
        h("div.source-head", h("label", { for: this.#spec.id }, "Source"), this.#openNow),
        h("div.source-entry", this.#suggested.element, this.#open),
        this.#error,
        h("p.hint", { id: "source-spec-help" }, hint),
      ),
      field("Calibration", this.#calibration),
      this.#inRun,
    );
    onSubmit(form, () => this.#submit());
    this.#suggested.asked = () => this.#suggest();
    this.#suggested.taken = (choice) => this.#take(choice);
    this.#cameras.chosen = (spec, pressed, error) =>
      void this.#openSource(spec, { button: pressed, indicator: pressed, error });
    this.#cameras.found = (cameras) => {
      this.#foundCameras = choicesOfCameras(cameras);
      this.#show();
    };
    this.append(h("h2", "Source"), form);
    for (const group of Object.values(this.#groups)) this.append(group.element);
    this.#groups.cameras.element.append(this.#cameras);
    this.#cameras.attach(this.hub);
    this.listen("status", () => this.#render());
    this.listen("calibrations", () => this.#loadCalibrations());
    this.listen("runs reconnected", () => this.#loadRuns());
    this.listen("reconnected", () => this.#load());
    this.whenShown(() => this.#pictures.go());
    void this.#load();
    void this.#loadRuns();
    void this.#loadCalibrations();
  }

  #makeGroups() {
    const group = (
      /** @type {SourceEntry["group"]} */ name,
      /** @type {string} */ title,
      /** @type {number} */ few,
      /** @type {HTMLElement[]} */ ...tools
    ) =>
      new SourceGroup(name, title, few, this.#pictures, (...it) => this.#pressed(...it), ...tools);
    const find = button("Find cameras", () => this.#cameras.look(), {
      class: "quiet",
      "data-harmless": true,
    });
    return {
      simulated: group("simulated", "Simulated", 4),
      cameras: group("cameras", "Cameras", 2, find),
      recordings: group("recordings", "Recordings", 2),
      folders: group("folders", "Folders and videos", 2),
    };
  }

  async #load() {
    /** @type {SourceEntry[] | null | undefined} */
    const entries = await this.#latestSources
      .run(() => request("GET", "/sources"))
      .catch(() => null);
    // Keep the previous sources if the server does not answer.
    if (!entries) return;
    this.hub.sources = entries;
    this.hub.emit("sources");
    this.#show();
  }

  async #loadRuns() {
    /** @type {History | null | undefined} */
    const history = await this.#latestRuns
      .run(() => request("GET", `/history?limit=${MAX_RUNS}`))
      .catch(() => null);
    if (!history) return;
    this.#runs = choicesOfRuns(history.runs);
    this.#show();
  }

  /** Show the tiles, the state of the field and the suggestions. */
  #show() {
    this.#showTiles();
    this.#render();
    this.#showSuggestions();
  }

  #showTiles() {
    const listed = this.hub.sources.map(choiceOfEntry);
    if (listed.length === 0) return;
    const all = merged([
      ...this.#foundCameras,
      ...this.#runs,
      ...listed.filter(({ template }) => !template),
      ...listed.filter(({ template }) => template),
    ]);
    for (const [name, group] of Object.entries(this.#groups))
      group.show(
        all.filter((choice) => choice.group === name),
        this.#current,
      );
  }

  get #current() {
    return shortSpec(this.hub.status?.source?.spec ?? "");
  }

  async #loadCalibrations() {
    /** @type {Calibration[]} */
    const all = await request("GET", "/calibrations").catch(() => []);
    offer(this.#calibration, [
      ["", "The source's own"],
      ...all.map((c) => [c.id, `${c.name} (${c.width} × ${c.height})`]),
    ]);
  }

  #render() {
    const { status } = this.hub;
    const current = this.#current;
    if (current !== this.#tilesOf) {
      this.#tilesOf = current;
      this.#showTiles();
    }
    // Follow the open source, but never overwrite what is being typed.
    if (current !== this.#followed && document.activeElement !== this.#spec) {
      this.#spec.value = current;
      this.#followed = current;
    }
    const name = status?.source?.name ?? "";
    setText(this.#openNow, name === status?.source?.spec ? "" : name);
    const inRun = Boolean(status?.run);
    this.#inRun.hidden = !inRun;
    this.#open.disabled = inRun;
    // Not disabled while opening: that would lose the focus.
    setAttribute(this.#open, "aria-disabled", this.#busy ? "true" : null);
    for (const tile of /** @type {NodeListOf<HTMLButtonElement>} */ (
      this.querySelectorAll(".source")
    )) {
      setAttribute(tile, "aria-current", tile.dataset.spec === current ? "true" : null);
      tile.disabled = inRun;
      setAttribute(tile, "aria-disabled", this.#busy ? "true" : null);
    }
  }

  /** The text to search for: that of the field, or empty (all) while it is the open source. */
  get #words() {
    const typed = this.#spec.value.trim();
    return typed === this.#followed ? "" : typed;
  }

  #suggest() {
    const words = this.#words;
    this.#showSuggestions();
    clearTimeout(this.#searchTimer);
    if (words) this.#searchTimer = setTimeout(() => this.#searchRuns(words), SEARCH_AFTER_MS);
  }

  #showSuggestions() {
    const listed = this.hub.sources.map(choiceOfEntry);
    const all = merged([...this.#foundCameras, ...listed, ...this.#foundRuns, ...this.#runs]);
    this.#suggested.show(suggestions(all, this.#words, MAX_PER_GROUP), ({ spec }) => spec);
  }

  /** Find runs among all stored ones by their names. @param {string} words */
  async #searchRuns(words) {
    const query = new URLSearchParams({ text: words.slice(0, 200), limit: String(MAX_PER_GROUP) });
    /** @type {History | null | undefined} */
    const found = await this.#search
      .run(() => request("GET", `/history?${query}`))
      .catch(() => null);
    if (!found || this.#words !== words) return;
    this.#foundRuns = choicesOfRuns(found.runs);
    this.#showSuggestions();
  }

  #submit() {
    const spec = this.#spec.value.trim();
    this.#suggested.close();
    if (!spec) return showError(this.#error, "Enter a source, for example simulated:lab.");
    return this.#openSource(spec, this.#field);
  }

  /** @returns {Pressed} */
  get #field() {
    return { button: this.#open, indicator: this.#open, error: this.#error };
  }

  /** @param {Choice} choice that was suggested */
  #take({ spec, template }) {
    this.#spec.value = spec;
    if (template) this.#spec.setSelectionRange(...placeholders(spec));
    else void this.#openSource(spec, this.#field);
  }

  /** @param {Choice} choice @param {HTMLButtonElement} tile */
  #pressed({ spec, template }, tile) {
    if (this.#busy) return;
    if (template) {
      this.#spec.value = spec;
      this.#spec.focus();
      this.#spec.setSelectionRange(...placeholders(spec));
      return;
    }
    setText(this.#tileError, "");
    tile.after(this.#tileError);
    const indicator = tile.querySelector(".source-line") ?? tile;
    void this.#openSource(spec, { button: tile, indicator, error: this.#tileError });
  }

  /**
   * Open a source, or the wizard if the source is meant for calibrating. The previous source stays
   * open if this one cannot be opened.
   *
   * @param {string} spec
   * @param {Pressed} pressed
   */
  async #openSource(spec, pressed) {
    if (this.#busy) return;
    this.#calibrate.hidden = true;
    for (const error of [this.#error, this.#tileError]) showError(error, "");
    const calibration = this.#calibration.value || null;
    if (!calibration && boardOf(this.hub.sources, spec)) return this.#openWizard(spec);
    const before = pressed.indicator.textContent ?? "";
    this.#setBusy(pressed, true, "Opening…");
    const opened = await attemptIn(pressed.error, async () => {
      /** @type {Status} */
      const status = await request("PUT", "/source", { source: spec, calibration });
      this.#followed = shortSpec(status.source?.spec ?? spec);
      this.#spec.value = this.#followed;
      this.hub.applyStatus(status);
      notify(`${status.source?.name ?? spec} is open.`);
    }).finally(() => this.#setBusy(pressed, false, before));
    if (opened) return this.#load();
    if (!pressed.error.textContent?.includes("has no calibration")) return;
    this.#uncalibrated = spec;
    pressed.error.after(this.#calibrate);
    this.#calibrate.hidden = false;
  }

  /** @param {Pressed} pressed @param {boolean} busy @param {string} words */
  #setBusy({ button, indicator }, busy, words) {
    this.#busy = busy;
    setAttribute(button, "aria-busy", busy ? "true" : null);
    setText(indicator, words);
    this.#render();
  }

  /** @param {string} spec */
  #openWizard(spec) {
    this.hub.uncalibrated = spec;
    this.hub.emit("calibrate");
  }
}

/** @param {Choice} choice */
function drawn({ title, spec, recent }) {
  const content = [h("b", title), h("code", spec)];
  if (recent !== null) content.push(h("span", "Recent"));
  return content;
}

customElements.define("observer-source-picker", SourcePicker);
