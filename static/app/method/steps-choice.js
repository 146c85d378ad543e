/** Chooses what the steps are computed from: source, frame and preset. */

import { button, field, h, input, offer, setAttribute, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { showError } from "../shell/notice.js";
import { choiceOfEntry, choicesOfRuns, merged } from "../sources/choices.js";
import { MODEL, storeOf } from "../parameters/parameter-store.js";

/** @import { History, MethodSteps, SourceEntry } from "../contract" */
/** @import { StepsPlace } from "./steps-address.js" */

const MAX_RUNS = 20;

/** The part of the place chosen here. @typedef {Partial<Omit<StepsPlace, "step">>} Choice */

export class StepsChoice extends Part {
  #source = h("select", { id: "steps-source" });
  #preset = h("select", { id: "steps-preset" });
  #slider = h("input", { type: "range", "aria-label": "Frame, slider", min: 1, step: 1 });
  #frame = input("number", "steps-frame", { min: 1, step: 1 });
  #error = h("p.field-error", { id: "steps-error", role: "alert" });
  /** Goes to a frame that exists instead of the one asked for. */
  #nearest = button("", () => this.chosen({ frame: this.#nearestFrame }, false), { hidden: true });
  /** @type {number | null} */
  #nearestFrame = null;
  /** The source asked for, shown before the answer and where there is none. @type {string | null} */
  #wanted = null;
  /** Spec and title of each source. @type {[string, string][]} */
  #sources = [];
  /** @type {MethodSteps | null} */
  #answer = null;

  /** Called with the choice, and whether the slider is still moving. @type {(choice: Choice, moving: boolean) => void} */
  chosen = () => {};

  build() {
    for (const each of [this.#source, this.#preset, this.#frame])
      setAttribute(each, "aria-describedby", this.#error.id);
    this.append(
      h(
        "div.steps-choice",
        field("Source", this.#source),
        field("Preset", this.#preset),
        h(
          "div.field",
          h("label", { for: "steps-frame" }, "Frame"),
          h("div.frame-choice", this.#slider, this.#frame),
        ),
      ),
      h("div.row", this.#error, this.#nearest),
    );
    this.#source.addEventListener("change", () =>
      // Another source has other frames.
      this.chosen({ source: this.#source.value, frame: null }, false),
    );
    this.#preset.addEventListener("change", () =>
      this.chosen({ preset: this.#preset.value, changes: {} }, false),
    );
    this.#slider.addEventListener("input", () => this.#moved(this.#slider.valueAsNumber, true));
    this.#frame.addEventListener("change", () => this.#moved(this.#frame.valueAsNumber, false));
    storeOf(this.hub).addEventListener("loaded", () => this.#offerPresets());
  }

  /** Load the choices. */
  async load() {
    const [entries, history] = await Promise.all([
      /** @type {Promise<SourceEntry[]>} */ (request("GET", "/sources")).catch(() => []),
      /** @type {Promise<History | null>} */ (request("GET", `/history?limit=${MAX_RUNS}`)).catch(
        () => null,
      ),
    ]);
    const listed = entries.filter(
      ({ template, board, group }) => !template && !board && group !== "cameras",
    );
    const choices = merged([...listed.map(choiceOfEntry), ...choicesOfRuns(history?.runs ?? [])]);
    this.#sources = choices.map(({ spec, title }) => [spec, title]);
    this.#offerSources();
  }

  /** Show what is asked for, before the answer. @param {StepsPlace} place */
  want({ source, frame, preset }) {
    this.#wanted = source ?? this.hub.status?.source?.spec ?? null;
    this.#offerSources();
    if (this.#answer) return;
    offer(this.#preset, [[preset, preset]], preset);
    if (frame !== null) for (const each of [this.#slider, this.#frame]) each.value = String(frame);
  }

  /** @param {MethodSteps} answer */
  show(answer) {
    this.#answer = answer;
    this.#wanted = answer.source;
    this.#offerSources();
    this.#offerPresets();
    const last = answer.frame_count === null ? null : answer.frame_count - 1;
    this.#slider.hidden = last === null;
    for (const each of [this.#slider, this.#frame]) {
      setAttribute(each, "max", last === null ? null : String(last));
      if (each !== document.activeElement) each.value = String(answer.frame);
    }
    this.fail("");
  }

  /** @param {string} sentence @param {number | null} [frame] to offer instead */
  fail(sentence, frame = null) {
    showError(this.#error, sentence);
    this.#nearestFrame = frame;
    this.#nearest.hidden = frame === null;
    setText(this.#nearest, `Go to frame ${frame}`);
  }

  /** @param {number} frame @param {boolean} moving */
  #moved(frame, moving) {
    if (!Number.isInteger(frame) || frame < 0)
      return this.fail("Enter a frame number, for example 40.");
    for (const each of [this.#slider, this.#frame]) each.value = String(frame);
    this.chosen({ frame }, moving);
  }

  #offerSources() {
    const source = this.#wanted;
    const there = source === null || this.#sources.some(([spec]) => spec === source);
    offer(
      this.#source,
      there ? this.#sources : [[source, source], ...this.#sources],
      source ?? this.#source.value,
    );
  }

  #offerPresets() {
    if (!this.#answer) return;
    const { models, preset } = this.#answer;
    const names = storeOf(this.hub)
      .presets.filter(({ values }) => models.includes(String(values[MODEL])))
      .map(({ name }) => name);
    if (!names.includes(preset)) names.unshift(preset);
    offer(
      this.#preset,
      names.map((name) => [name, name]),
      preset,
    );
  }
}

customElements.define("observer-steps-choice", StepsChoice);
