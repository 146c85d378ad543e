/** One parameter: its control made from its declaration, with help, error and reset. */

import { h, icon, setText } from "./dom.js";

/** @typedef {import("./types.js").ParameterEntry} ParameterEntry */
/** @typedef {import("./types.js").ParameterValue} ParameterValue */
/** @typedef {import("./parameter-store.js").ParameterStore} ParameterStore */

const SLIDER_STEPS = 1000;
// From this ratio of largest to smallest on, a slider's scale is logarithmic.
const LOGARITHMIC_FROM = 100;
const SEND_EVERY_MS = 120;

export class ParameterField extends HTMLElement {
  #error = h("p", { class: "field-error", role: "alert" });
  #reset = h("button", { type: "button", class: "quiet reset" }, icon("restart"));
  /** @type {(value: ParameterValue) => void} */
  #show = () => {};
  /** @type {ParameterValue | undefined} */
  #shown;

  /**
   * @param {ParameterEntry} entry
   * @param {ParameterStore} store
   */
  build(entry, store) {
    this.entry = entry;
    this.store = store;
    const id = `parameter-${entry.name.replace(".", "-")}`;
    this.dataset.name = entry.name;
    this.#error.id = `${id}-error`;
    const reset = `Reset ${entry.title}`;
    this.#reset.setAttribute("aria-label", reset);
    this.#reset.addEventListener("click", () => this.#commit(store.defaults[entry.name] ?? entry.default));
    this.append(
      h("div", { class: "parameter-head" }, h("label", { for: id }, entry.title), this.#reset),
      this.#controls(id),
      this.#error,
      h("p", { class: "hint", id: `${id}-help` }, entry.help, " ", h("span", { class: "range" }, rangeInWords(entry))),
    );
  }

  /** The server's value. @param {ParameterValue} value */
  show(value) {
    const fallback = this.store?.defaults[this.entry?.name ?? ""];
    const changed = value !== fallback;
    this.toggleAttribute("data-changed", changed);
    this.#reset.hidden = !changed;
    this.#reset.title = `Back to ${String(fallback)}`;
    if (value !== this.#shown) this.fail("");
    this.#shown = value;
    this.#show(value);
  }

  /** @param {string} message empty takes the error away */
  fail(message) {
    const kept = message ? `Refused: ${message}. It stays at ${String(this.#shown)}.` : "";
    setText(this.#error, kept);
    for (const control of this.querySelectorAll("input, select")) {
      if (message) control.setAttribute("aria-invalid", "true");
      else control.removeAttribute("aria-invalid");
    }
  }

  /** Whether the text field holds an edit that has not been sent: then Ctrl+Z is the text's. */
  get isEdited() {
    const text = this.querySelector('input[type="number"]');
    return text instanceof HTMLInputElement && text.value !== tidy(this.#shown);
  }

  /** @param {string} term @returns {boolean} whether it is about that */
  isAbout(term) {
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
    const described = { "aria-describedby": `${id}-error ${id}-help` };
    if (entry.type === "boolean") {
      const box = h("input", { type: "checkbox", id, class: "switch", ...described });
      box.addEventListener("change", () => this.#commit(box.checked));
      this.#show = (value) => (box.checked = value === true);
      return h("div", { class: "parameter-controls" }, box);
    }
    if (entry.type === "choice") {
      const options = (entry.choices ?? []).map((choice) => h("option", { value: choice }, choice));
      const select = h("select", { id, ...described }, ...options);
      select.addEventListener("change", () => this.#commit(select.value));
      this.#show = (value) => (select.value = String(value));
      return h("div", { class: "parameter-controls" }, select);
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
    const slider = h("input", { type: "range", "aria-label": `${entry.title}, slider`, ...scale.attributes });
    const number = h("input", { type: "number", id, min: entry.minimum, max: entry.maximum, step: entry.step, ...described });
    /** @type {ParameterValue | undefined} */
    let before;
    let timer = 0;
    slider.addEventListener("input", () => {
      before ??= this.#shown;
      const value = scale.valueAt(slider.valueAsNumber);
      number.value = tidy(value);
      slider.setAttribute("aria-valuetext", `${tidy(value)} ${entry.unit}`);
      // The effect is seen while the slider moves; one step of undo covers the whole movement.
      if (!timer) {
        timer = setTimeout(() => {
          timer = 0;
          void this.store?.change({ [entry.name]: scale.valueAt(slider.valueAsNumber) });
        }, SEND_EVERY_MS);
      }
    });
    slider.addEventListener("change", () => {
      clearTimeout(timer);
      timer = 0;
      this.#commit(scale.valueAt(slider.valueAsNumber), before);
      before = undefined;
    });
    // What is no number is sent as it is: the server says what would be right.
    number.addEventListener("change", () =>
      this.#commit(Number.isFinite(number.valueAsNumber) ? number.valueAsNumber : number.value),
    );
    this.#show = (value) => {
      if (before !== undefined) return;
      number.value = tidy(value);
      slider.value = String(scale.placeOf(Number(value)));
      slider.setAttribute("aria-valuetext", `${tidy(value)} ${entry.unit}`);
    };
    return h("div", { class: "parameter-controls" }, slider, number, h("span", { class: "unit" }, entry.unit));
  }
}

/**
 * How a slider's places and a parameter's values belong together.
 *
 * @param {ParameterEntry} entry
 */
function scaleOf({ minimum = 0, maximum = 1, step = 1, type }) {
  if (minimum <= 0 || maximum / minimum < LOGARITHMIC_FROM) {
    return {
      attributes: { min: minimum, max: maximum, step },
      valueAt: (/** @type {number} */ place) => place,
      placeOf: (/** @type {number} */ value) => value,
    };
  }
  const ratio = Math.log(maximum / minimum);
  return {
    attributes: { min: 0, max: SLIDER_STEPS, step: 1 },
    valueAt: (/** @type {number} */ place) => {
      const value = minimum * Math.exp((ratio * place) / SLIDER_STEPS);
      const stepped = minimum + Math.round((value - minimum) / step) * step;
      const bounded = Math.min(maximum, Math.max(minimum, stepped));
      return type === "integer" ? Math.round(bounded) : Number(bounded.toPrecision(6));
    },
    placeOf: (/** @type {number} */ value) =>
      Math.round((SLIDER_STEPS * Math.log(value / minimum)) / ratio),
  };
}

/** @param {ParameterEntry} entry */
function rangeInWords({ minimum, maximum, unit, type }) {
  if (type !== "number" && type !== "integer") return "";
  return `${minimum} to ${maximum}${unit ? ` ${unit}` : ""}.`;
}

/** @param {ParameterValue | undefined} value */
function tidy(value) {
  return typeof value === "number" ? String(Number(value.toPrecision(7))) : String(value ?? "");
}

customElements.define("observer-parameter", ParameterField);
