/** The paper's method step by step, on one frozen pair of frames. */

import { button, download, h, setAttribute, setText, table, tableRow } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { fixed, sentence } from "../elements/words.js";
import { declareKeys, writesText } from "../elements/keys.js";
import { ExportMenu } from "../elements/export-menu.js";
import { MODEL, storeOf } from "../parameters/parameter-store.js";
import { groupTitle } from "../parameters/value-words.js";
import { ApiError, request, requestImage } from "../shell/api.js";
import { attempt } from "../shell/notice.js";
import { LatestRequest } from "../elements/latest-request.js";
import { StepFields } from "./step-fields.js";
import { formulaParts } from "./step-formula.js";
import { StepPicture } from "./step-picture.js";
import { StepPresentation } from "./step-presentation.js";
import {
  addressOf,
  areSameFrames,
  placeOfAddress,
  queryOf,
  stepByKey,
  STEP_KEYS,
  STEPS,
  valuesAt,
  nearestFrame,
} from "./steps-address.js";
import { StepsChoice } from "./steps-choice.js";

/** @import { MethodStep, MethodSteps } from "../contract" */
/** @import { Values } from "../parameters/parameter-store.js" */
/** @import { StepsPlace } from "./steps-address.js" */

declareKeys(
  "Method steps",
  ["← →", "Previous and next step"],
  ["1 2 3 4 5 6 7 8 9", "Go to this step"],
  ["F P", "Start or exit the presentation"],
);

// Delay after the last movement of a slider.
const PAUSE_MS = 150;
// The next step's picture is preloaded this long after the current one is shown.
const PREPARE_MS = 400;
// Elements that use arrows and letters themselves.
const OWN_KEYS =
  'input, select, textarea, [role="tab"], [role="listbox"], [role="menu"], [role="separator"], dialog, .uplot';
const FORMATS = /** @type {const} */ ([
  ["png", "PNG", "image, 150 dpi"],
  ["svg", "SVG", "vector graphics"],
  ["pdf", "PDF", "vector graphics, for print"],
  ["csv", "CSV", "the data behind the picture"],
]);

export class StepsView extends Part {
  #choice = new StepsChoice();
  #strip = h("ol.steps-strip");
  #title = h("h3", "Loading…");
  #text = h("p");
  #picture = new StepPicture();
  #caption = h("figcaption");
  #formula = h("div.step-formula");
  #error = h("p.field-error", { role: "alert" });
  #status = h("p.visually-hidden", { role: "status" });
  #numbers = h("div");
  #fields = new StepFields();
  #export = new ExportMenu(() => [{ title: "This step", items: this.#exports() }]);
  /** @type {StepPresentation | null} */
  #presentation = null;
  #latest = new LatestRequest();
  /** What is shown; null: another page is. @type {StepsPlace | null} */
  #place = null;
  /** @type {MethodSteps | null} */
  #answer = null;
  #timer = 0;
  #preparing = 0;

  build() {
    for (const [at, key] of STEP_KEYS.entries()) {
      const words = [h("b", String(at + 1)), h("span", groupTitle(key))];
      const go = button(words, () => this.#go(at + 1), { class: "steps-button" });
      this.#strip.append(h("li", go));
    }
    const present = button("Present", () => this.#present(), {
      title: "Full screen (F or P)",
    });
    this.append(
      this.#choice,
      h("nav", { "aria-label": "Steps of the method" }, this.#strip),
      h(
        "div.steps-body",
        h(
          "section.steps-main",
          h("div.steps-head", this.#title, h("div.row", present, this.#export)),
          this.#text,
          this.#error,
          h("figure", this.#picture.element, this.#caption),
          this.#formula,
        ),
        h(
          "section.steps-side",
          h("h3", "Parameters of this step"),
          ...this.#fields.elements,
          h("h3", "Numbers"),
          this.#numbers,
        ),
      ),
      this.#status,
    );
    this.#choice.attach(this.hub);
    this.#choice.chosen = (choice, moving) => this.#change(choice, moving);
    this.#fields.changed = (values, moving) => this.#takeValues(values, moving);
    this.#picture.shown = (url, alt) => this.#presentation?.show(url, alt);
    storeOf(this.hub).addEventListener("loaded", () => this.#render());
    this.listen("themechange", () => this.#draw(), window);
    this.listen("change", () => this.#draw(), matchMedia("(prefers-color-scheme: dark)"));
    document.addEventListener("keydown", (event) => this.#pressed(event));
  }

  /** @param {string | null} hash the page's address; null: another page is shown */
  show(hash) {
    this.hidden = hash === null;
    if (hash === null) {
      this.#place = null;
      this.#presentation?.close();
      return;
    }
    const first = this.#place === null;
    const place = placeOfAddress(hash);
    const same = this.#place !== null && addressOf(this.#place) === addressOf(place);
    this.#place = place;
    if (first) void this.#choice.load();
    if (!same) void this.#load();
  }

  // --- what is shown -------------------------------------------------------------------------

  /** @param {number} step */
  #go(step) {
    if (!this.#place || step === this.#place.step) return;
    this.#place = { ...this.#place, step };
    history.pushState(null, "", addressOf(this.#place));
    this.#render();
    this.#draw();
  }

  /**
   * @param {Partial<StepsPlace>} choice
   * @param {boolean} moving whether the slider is still moving
   */
  #change(choice, moving) {
    if (!this.#place) return;
    this.#place = { ...this.#place, ...choice };
    const address = addressOf(this.#place);
    // Do not add an entry to the browser's history for every slider position.
    if (choice.source || choice.preset) history.pushState(null, "", address);
    else history.replaceState(null, "", address);
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => void this.#load(), moving ? PAUSE_MS : 0);
  }

  /** @param {Values} values @param {boolean} moving */
  #takeValues(values, moving) {
    if (!this.#place) return;
    const changes = { ...this.#place.changes };
    for (const [name, value] of Object.entries(values)) {
      if (value === this.#fields.defaults[name]) delete changes[name];
      else changes[name] = String(value);
    }
    this.#change({ changes }, moving);
  }

  // --- asking the server ---------------------------------------------------------------------

  async #load() {
    const place = this.#place;
    if (!place) return;
    clearTimeout(this.#timer);
    this.#choice.want(place);
    this.#render();
    if (!this.#answer) setText(this.#title, "Loading…");
    setAttribute(this, "aria-busy", "true");
    /** @type {Promise<MethodSteps | undefined>} */
    const asked = this.#latest.run(() => request("GET", `/steps?${queryOf(place)}`));
    // If the server chooses the frame, only its answer tells which one.
    const drawing = place.frame === null ? null : this.#draw();
    try {
      const answer = await asked;
      // What was chosen meanwhile is loaded next.
      if (answer === undefined || !areSameFrames(place, this.#place)) return;
      this.#take(answer);
      if (drawing === null) this.#draw();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (!areSameFrames(place, this.#place)) return;
      this.#refused(error);
    }
    setAttribute(this, "aria-busy", null);
  }

  /** @param {MethodSteps} answer */
  #take(answer) {
    const place = /** @type {StepsPlace} */ (this.#place);
    this.#answer = answer;
    this.#fields.defaults = /** @type {Values} */ (answer.preset_values);
    this.#place = { ...place, source: answer.source, frame: answer.frame };
    // If the user went back or forward meanwhile, another place is shown next.
    if (addressOf(placeOfAddress(location.hash)) === addressOf(place))
      history.replaceState(null, "", addressOf(this.#place));
    this.#choice.show(answer);
    setText(this.#error, "");
    this.#render();
  }

  /** Report a refusal; what was shown stays. @param {ApiError} error */
  #refused({ fields, message }) {
    const { changes, frame } = /** @type {StepsPlace} */ (this.#place);
    const refused = Object.keys(fields).filter((name) => name in changes);
    const seen = refused.filter((name) => this.#fields.shows(name));
    if (seen.length > 0) {
      for (const name of seen) delete changes[name];
      history.replaceState(null, "", addressOf(/** @type {StepsPlace} */ (this.#place)));
      // The fields show the values that stay, and then why.
      this.#render();
      for (const name of seen) this.#fields.fail(name, fields[name] ?? "");
    }
    if (seen.length === 0 || seen.length < refused.length)
      this.#choice.fail(message, nearestFrame(fields["frame"] ?? "", frame));
    if (!this.#answer) setText(this.#title, "These frames cannot be shown");
  }

  /** Show the picture of the present step. */
  async #draw() {
    const place = this.#place;
    if (!place) return;
    clearTimeout(this.#preparing);
    const step = this.#step;
    try {
      const alt = step ? `Step ${step.number}, ${step.title}. ${step.caption}` : "";
      if (!(await this.#picture.show(picturePath(place), alt))) return;
      setText(this.#error, "");
      const next = { ...place, step: (place.step % STEPS) + 1 };
      this.#preparing = setTimeout(() => this.#picture.prepare(picturePath(next)), PREPARE_MS);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      // Errors in the choice are shown where it was made.
      if (error.status !== 422) setText(this.#error, error.message);
    }
  }

  #exports() {
    return FORMATS.map(([format, words, help]) => ({
      words,
      help,
      take: () =>
        attempt(async () => {
          const place = this.#place;
          const step = this.#step;
          if (!place || !step) return;
          const { blob } = await requestImage(`/steps/${step.number}.${format}?${queryOf(place)}`);
          download(blob, `step-${step.number}-${step.key}-frame-${place.frame}.${format}`);
        }),
    }));
  }

  // --- rendering -----------------------------------------------------------------------------

  /** The values asked for, even before the answer, lest a field fall back to its old value. */
  get #values() {
    const { preset, values = {} } = this.#answer ?? {};
    // Of a preset just chosen, the values are not known yet.
    if (!this.#place || this.#place.preset !== preset) return /** @type {Values} */ (values);
    return valuesAt(this.#place, this.#fields.defaults);
  }

  /** The parameters as declared, with the methods that these steps belong to. */
  get #schema() {
    const models = this.#answer?.models ?? [];
    return storeOf(this.hub).schema.map((entry) =>
      entry.name === MODEL ? { ...entry, choices: models } : entry,
    );
  }

  /** @returns {MethodStep | undefined} */
  get #step() {
    const number = this.#place?.step;
    return this.#answer?.steps.find((step) => step.number === number);
  }

  #render() {
    const number = this.#place?.step;
    for (const [at, item] of [...this.#strip.children].entries()) {
      const go = /** @type {HTMLElement} */ (item.firstElementChild);
      setAttribute(go, "aria-current", at + 1 === number ? "step" : null);
    }
    const step = this.#step;
    if (!step || !this.#answer) return;
    setText(this.#title, `${step.number}. ${step.title}`);
    setText(this.#text, step.text);
    setText(this.#caption, step.caption);
    setText(this.#status, `Step ${step.number}, ${step.title}`);
    this.#formula.replaceChildren(...formulaParts(step));
    const rows = step.numbers.map(({ name, value, unit, digits }) =>
      tableRow(name, `${fixed(value, digits)}${unit && value !== null ? ` ${unit}` : ""}`),
    );
    this.#numbers.replaceChildren(
      step.missing ? h("p.hint", sentence(step.missing)) : "",
      table("step-numbers", [], rows),
    );
    this.#presentation?.update(step);
    this.#fields.show(step.parameters, this.#values, this.#schema);
  }

  // --- keys and presenting -------------------------------------------------------------------

  #present() {
    if (!this.#presentation) {
      this.#presentation = new StepPresentation(this.hub);
      this.#presentation.stepped = (by) => this.#go(clamped((this.#place?.step ?? 1) + by));
    }
    if (this.#step) this.#presentation.update(this.#step);
    this.#presentation.open();
    void this.#draw();
  }

  /** @param {KeyboardEvent} event */
  #pressed(event) {
    const place = this.#place;
    if (!place || event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    const target = event.target instanceof HTMLElement ? event.target : document.body;
    const presents = this.#presentation?.isOpen === true;
    if (!presents && (writesText(target) || target.closest(OWN_KEYS))) return;
    // The user may be driving with the arrow keys.
    if (!presents && this.hub.driver.blockedReason === "") return;
    if (/^[fp]$/i.test(event.key)) {
      event.preventDefault();
      if (presents) this.#presentation?.close();
      else this.#present();
      return;
    }
    const step = stepByKey(event.key, place.step, presents);
    if (step === null) return;
    event.preventDefault();
    this.#go(step);
  }
}

/** @param {StepsPlace} place */
function picturePath(place) {
  const look = document.documentElement.dataset.theme;
  const dark =
    look === "dark" || (look !== "light" && matchMedia("(prefers-color-scheme: dark)").matches);
  const query = queryOf(place, { labelled: "false", ...(dark ? { dark: "true" } : {}) });
  return `/steps/${place.step}.svg?${query}`;
}

/** @param {number} step */
function clamped(step) {
  return Math.min(STEPS, Math.max(1, step));
}

customElements.define("observer-steps", StepsView);
