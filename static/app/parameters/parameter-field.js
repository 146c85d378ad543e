/** One parameter: a control built from its declaration, with help, badge, error and reset. */

import { button, h, icon, input, select, setAttribute, setText } from "../elements/dom.js";
import { helpButton } from "./help-button.js";
import { rangeInWords, roundOff, unitInWords, valueInWords } from "./value-words.js";

/** @import { ParameterEntry, ParameterValue, Values } from "./parameter-store.js" */

/**
 * Source and target of values: the server's store, or a draft.
 *
 * @typedef {object} ValueStore
 * @property {Values} defaults values that reset restores
 * @property {(changes: Values) => Promise<unknown>} change
 * @property {(changes: Values, before?: Values) => Promise<unknown>} changeUndoably
 */

const SLIDER_STEPS = 1000;
// From this ratio of largest to smallest on, a slider's scale is logarithmic.
const LOGARITHMIC_FROM = 100;
const KEY_SHARE = 0.05;
const SEND_EVERY_MS = 120;
/** @type {Record<string, 1 | -1>} */
const ARROWS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };

export class ParameterField extends HTMLElement {
  #error = h("p.field-error", { role: "alert" });
  #idle = h("p.hint.idle");
  #badge = h("span.changed-badge", { hidden: true });
  #reset = button(icon("restart"), null, { class: "quiet reset" });
  /** @type {(value: ParameterValue) => void} */
  #show = () => {};
  /** @type {ParameterValue | undefined} */
  #shown;

  /**
   * @param {ParameterEntry} entry
   * @param {ValueStore} store
   * @param {string} [prefix] of the controls' ids, to tell several forms apart
   */
  build(entry, store, prefix = "parameter") {
    this.entry = entry;
    this.store = store;
    const id = `${prefix}-${entry.name.replace(".", "-")}`;
    this.dataset.name = entry.name;
    this.#error.id = `${id}-error`;
    this.#badge.id = `${id}-changed`;
    this.#reset.setAttribute("aria-label", `Reset ${entry.title}`);
    this.#reset.addEventListener("click", () =>
      this.#commit(store.defaults[entry.name] ?? entry.default),
    );
    const range = rangeInWords(entry);
    const [help, box] = helpButton(
      `${id}-help`,
      entry.title,
      h("p", entry.help),
      h("p.hint", range && `${range}. `, `Default: ${valueInWords(entry.default, entry)}.`),
      h("p.hint", h("code", entry.name)),
    );
    this.append(
      h("div.parameter-head", h("label", { for: id }, entry.title), this.#badge, this.#reset, help),
      this.#controls(id),
      this.#idle,
      this.#error,
      box,
    );
  }

  /**
   * @param {ParameterValue} value the server's
   * @param {string} model in force: some models do not use the parameter
   */
  show(value, model) {
    const entry = /** @type {ParameterEntry} */ (this.entry);
    const used = model === "" || entry.models.includes(model);
    const cloud = entry.cloud === true;
    this.toggleAttribute("data-idle", !used && !cloud);
    const unused = cloud
      ? `With the ${model} method, it affects only the point cloud.`
      : `Not used by the ${model} method.`;
    setText(this.#idle, used ? "" : unused);
    this.#idle.hidden = used;
    const fallback = this.store?.defaults[entry.name];
    const changed = value !== fallback;
    this.toggleAttribute("data-changed", changed);
    this.#badge.hidden = this.#reset.hidden = !changed;
    setText(this.#badge, `was ${this.#bare(fallback)}`);
    this.#reset.title = `Reset to ${valueInWords(fallback, entry)}`;
    if (value !== this.#shown) this.fail("");
    this.#shown = value;
    this.#show(value);
  }

  /** Say a value without its unit, which is next to the field. @param {ParameterValue | undefined} value */
  #bare(value) {
    const entry = /** @type {ParameterEntry} */ (this.entry);
    return valueInWords(value, { ...entry, unit: "" });
  }

  /** @param {string} message empty removes the error */
  fail(message) {
    const kept = message
      ? `Not applied: ${message.replace(/\.$/, "")}. The value stays at ${this.#bare(this.#shown)}.`
      : "";
    setText(this.#error, kept);
    for (const control of this.querySelectorAll("input, select"))
      setAttribute(control, "aria-invalid", message ? "true" : null);
  }

  /** True while the text field holds an unsent edit: then Ctrl+Z belongs to the text. */
  get isEdited() {
    const text = this.querySelector('input[type="number"]');
    return text instanceof HTMLInputElement && text.value !== roundOff(this.#shown);
  }

  /** @param {string} term @returns {boolean} whether the term occurs in its texts */
  matchesSearch(term) {
    const { name, title, help, group } = /** @type {ParameterEntry} */ (this.entry);
    return `${name} ${title} ${help} ${group}`.toLowerCase().includes(term);
  }

  /**
   * @param {ParameterValue} value
   * @param {ParameterValue} [before]
   */
  #commit(value, before = this.#shown) {
    const { entry, store } = this;
    if (!entry || !store || before === undefined) return;
    this.fail("");
    void store.changeUndoably({ [entry.name]: value }, { [entry.name]: before });
  }

  /** @param {string} id */
  #controls(id) {
    const entry = /** @type {ParameterEntry} */ (this.entry);
    const described = { "aria-describedby": `${id}-error ${id}-changed ${id}-help` };
    if (entry.type === "boolean") {
      const box = h("input.switch", { type: "checkbox", id, ...described });
      box.addEventListener("change", () => this.#commit(box.checked));
      this.#show = (value) => (box.checked = value === true);
      return h("div.parameter-controls", box);
    }
    if (entry.type === "choice") {
      const choices = (entry.choices ?? []).map((each) => [each, valueInWords(each, entry)]);
      const list = select({ id, ...described }, choices);
      list.addEventListener("change", () => this.#commit(list.value));
      this.#show = (value) => (list.value = String(value));
      return h("div.parameter-controls", list);
    }
    return this.#numberControls(id, described);
  }

  /**
   * @param {string} id
   * @param {Record<string, string>} described
   */
  #numberControls(id, described) {
    const entry = /** @type {ParameterEntry} */ (this.entry);
    const scale = scaleOf(entry);
    const slider = h("input", {
      type: "range",
      "aria-label": `${entry.title}, slider`,
      ...scale.attributes,
    });
    const number = input("number", id, {
      min: entry.minimum,
      max: entry.maximum,
      step: entry.step,
      ...described,
    });
    // True while the text field holds an unsent edit, which values shown meanwhile do not replace.
    let typing = false;
    const display = (/** @type {ParameterValue} */ value) => {
      const text = roundOff(value);
      if (!typing) number.value = text;
      slider.setAttribute("aria-valuetext", `${text} ${unitInWords(entry.unit)}`);
    };
    const gesture = this.#gesture(display);
    slider.addEventListener("input", () => gesture.move(scale.valueAt(slider.valueAsNumber)));
    slider.addEventListener("change", () => gesture.end());
    slider.addEventListener("keydown", (event) => {
      const direction = ARROWS[event.key];
      if (!direction || !scale.next) return;
      event.preventDefault();
      const value = scale.next(number.valueAsNumber, direction);
      slider.value = String(scale.placeOf(value));
      gesture.move(value);
    });
    slider.addEventListener("keyup", () => gesture.end());
    number.addEventListener("input", () => (typing = true));
    number.addEventListener("blur", () => {
      // While another window has the focus, the edit is not over.
      if (!typing || number === document.activeElement) return;
      typing = false;
      if (this.#shown !== undefined) display(this.#shown);
    });
    number.addEventListener("change", () => {
      typing = false;
      // Text that is not a number is sent unchanged: the server says what would be valid.
      this.#commit(Number.isFinite(number.valueAsNumber) ? number.valueAsNumber : number.value);
    });
    this.#show = (value) => {
      if (gesture.underWay) return;
      display(value);
      slider.value = String(scale.placeOf(Number(value)));
    };
    return h("div.parameter-controls", slider, number, h("span.unit", unitInWords(entry.unit)));
  }

  /**
   * Handle one movement of the slider: it takes effect as it moves and is a single undo step.
   *
   * @param {(value: number) => void} display
   */
  #gesture(display) {
    const name = /** @type {ParameterEntry} */ (this.entry).name;
    /** @type {ParameterValue | undefined} */
    let before;
    /** @type {number | undefined} */
    let value;
    let timer = 0;
    return {
      get underWay() {
        return value !== undefined;
      },
      move: (/** @type {number} */ to) => {
        if (value === undefined) before = this.#shown;
        value = to;
        display(to);
        timer ||= setTimeout(() => {
          timer = 0;
          if (value !== undefined) void this.store?.change({ [name]: value });
        }, SEND_EVERY_MS);
      },
      end: () => {
        if (value === undefined) return;
        const last = value;
        clearTimeout(timer);
        timer = 0;
        value = undefined;
        this.#commit(last, before);
      },
    };
  }
}

/**
 * Map slider positions to parameter values and back.
 *
 * @param {ParameterEntry} entry
 */
function scaleOf({ minimum, maximum, step, type }) {
  if (minimum <= 0 || maximum / minimum < LOGARITHMIC_FROM) {
    return {
      attributes: { min: minimum, max: maximum, step },
      valueAt: (/** @type {number} */ place) => place,
      placeOf: (/** @type {number} */ value) => value,
      next: null,
    };
  }
  const ratio = Math.log(maximum / minimum);
  const allowed = (/** @type {number} */ value) => {
    const stepped = minimum + Math.round((value - minimum) / step) * step;
    const bounded = Math.min(maximum, Math.max(minimum, stepped));
    return type === "integer" ? Math.round(bounded) : Number(bounded.toPrecision(6));
  };
  return {
    attributes: { min: 0, max: SLIDER_STEPS, step: 1 },
    valueAt: (/** @type {number} */ place) =>
      allowed(minimum * Math.exp((ratio * place) / SLIDER_STEPS)),
    placeOf: (/** @type {number} */ value) =>
      Math.round((SLIDER_STEPS * Math.log(value / minimum)) / ratio),
    // A key moves by a few per cent, but at least by one step.
    next: (/** @type {number} */ value, /** @type {1 | -1} */ direction) =>
      allowed(value + direction * Math.max(step, value * KEY_SHARE)),
  };
}

customElements.define("observer-parameter", ParameterField);
