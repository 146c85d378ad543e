/** Live motion capture: what is listened to, what comes from it, and how it is aligned. */

import { button, field, h, onSubmit, setAttribute, setText, textInput } from "../elements/dom.js";
import { KeptList } from "../elements/focus-place.js";
import { Part } from "../elements/part.js";
import { fixed, sentence } from "../elements/words.js";
import { ApiError, request } from "../shell/api.js";
import { notify } from "../shell/notice.js";

/** @import { LiveTruthStatus } from "../contract" */

/** @type {Record<string, [string, string]>} words and colour of the chip */
const STATES = {
  connecting: ["connecting", "connecting"],
  waiting: ["no body is seen", "connecting"],
  receiving: ["receiving", "running"],
};

class LiveTruthForm extends Part {
  #spec = textInput("live-truth-spec", {
    spellcheck: "false",
    required: true,
    placeholder: "vrpn:HOST",
    "aria-describedby": "live-truth-help live-truth-error",
  });
  #listen = h("button.button", { type: "submit" }, "Listen");
  #stop = button("Stop listening", () => this.#end(), { hidden: true });
  #error = h("p.field-error", { id: "live-truth-error", role: "alert" });
  #state = h("span.state-chip");
  #sentence = h("p", { role: "status" });
  #trouble = h("p.warnings.hint");
  #clock = h("p.hint.figure");
  #observer = h("select", { id: "live-truth-observer" });
  #list = h("ul.live-bodies");
  #bodies = new KeptList(
    this.#list,
    (/** @type {string} */ name) => this.#body(name),
    () => this.#observer,
  );
  /** @type {Map<string, HTMLElement>} */
  #rates = new Map();
  #heard = h("div.stack", { hidden: true });
  #names = "";
  #followed = "";
  #busy = false;

  build() {
    const form = h(
      "form.stack",
      { novalidate: true },
      h(
        "div.field",
        h("label", { for: "live-truth-spec" }, "Listen to"),
        this.#spec,
        this.#error,
        h(
          "p.hint",
          { id: "live-truth-help" },
          "vrpn:HOST for a VRPN server such as Vicon Tracker's, vicon-udp:51001 for its UDP object stream. It is aligned while both move, and recorded with every run.",
        ),
      ),
      h("div.row", this.#listen, this.#stop),
    );
    this.#heard.append(
      h("p.row", this.#state),
      this.#trouble,
      this.#sentence,
      this.#clock,
      field("The observer is", this.#observer),
      h("div.named-part", h("span.field-name", "Compared bodies"), this.#list),
    );
    this.append(h("h3", "Live motion capture"), form, this.#heard);
    onSubmit(form, () => this.#begin());
    this.#observer.addEventListener("change", () => void this.#choose());
    this.hear("status", () => this.#render());
    this.#render();
  }

  #render() {
    const truth = this.hub.status?.truth ?? null;
    const spec = truth?.spec ?? "";
    // Follow what is listened to, but never overwrite what is being typed.
    if (spec !== this.#followed && document.activeElement !== this.#spec) {
      this.#spec.value = spec;
      this.#followed = spec;
    }
    if (!truth && this.#stop === document.activeElement) this.#spec.focus();
    this.#stop.hidden = truth === null;
    this.#heard.hidden = truth === null;
    if (!truth) return;
    const [words, colour] = STATES[truth.state] ?? [truth.state, ""];
    setText(this.#state, words ?? "");
    setAttribute(this.#state, "data-state", colour ?? "");
    setText(this.#trouble, truth.trouble ? sentence(truth.trouble) : "");
    this.#trouble.hidden = !truth.trouble;
    setText(this.#sentence, sentence(truth.sentence));
    setText(this.#clock, clockInWords(truth));
    this.#clock.hidden = truth.clock === null;
    this.#renderBodies(truth);
  }

  /** @param {LiveTruthStatus} truth */
  #renderBodies({ bodies, observer, ignore }) {
    const names = [
      ...new Set([...bodies.map(({ name }) => name), ...ignore, ...(observer ? [observer] : [])]),
    ].sort();
    if (names.join("\n") !== this.#names) {
      this.#names = names.join("\n");
      this.#observer.replaceChildren(
        h("option", { value: "" }, "found out by its motion"),
        ...names.map((name) => h("option", { value: name }, name)),
      );
    }
    if (document.activeElement !== this.#observer) this.#observer.value = observer ?? "";
    this.#bodies.show(names, (name) => name);
    for (const [at, name] of names.entries()) {
      const box = this.#list.children[at]?.querySelector("input");
      if (box && document.activeElement !== box) box.checked = !ignore.includes(name);
      const body = bodies.find((each) => each.name === name);
      const rate = this.#rates.get(name);
      if (rate)
        setText(
          rate,
          [body?.role, body ? rateInWords(body.rate_hz) : "not seen"].filter(Boolean).join(", "),
        );
    }
  }

  /** @param {string} name */
  #body(name) {
    const box = h("input", { type: "checkbox", value: name, checked: true });
    box.addEventListener("change", () => void this.#choose());
    const rate = h("span.hint.figure");
    this.#rates.set(name, rate);
    return h("li", h("label.check", box, name), rate);
  }

  async #begin() {
    const spec = this.#spec.value.trim();
    if (!spec) return this.#fail("Say where it comes from, as in vrpn:192.168.0.5.");
    await this.#put({ spec, observer: null, ignore: [] }, this.#listen, "Connecting…");
  }

  async #end() {
    if (await this.#put({ spec: null, observer: null, ignore: [] }, this.#stop, "Stopping…"))
      notify("Motion capture is not listened to any more.");
  }

  async #choose() {
    const spec = this.hub.status?.truth?.spec;
    if (!spec) return;
    const left = /** @type {NodeListOf<HTMLInputElement>} */ (
      this.#list.querySelectorAll("input:not(:checked)")
    );
    await this.#put({
      spec,
      observer: this.#observer.value || null,
      ignore: [...left].map(({ value }) => value),
    });
  }

  /**
   * @param {{spec: string | null, observer: string | null, ignore: string[]}} order
   * @param {HTMLElement} [button] says what goes on
   * @param {string} [words]
   * @returns {Promise<boolean>} whether it was taken
   */
  async #put(order, button, words) {
    if (this.#busy) return false;
    this.#busy = true;
    this.#fail("");
    const before = button?.textContent ?? "";
    if (button && words) setText(button, words);
    try {
      /** @type {LiveTruthStatus | null} */
      const truth = await request("PUT", "/truth/live", order);
      this.#followed = truth?.spec ?? "";
      if (this.hub.status) this.hub.takeStatus({ ...this.hub.status, truth });
      return true;
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      this.#fail(error.message);
      return false;
    } finally {
      this.#busy = false;
      if (button) setText(button, before);
      this.#render();
    }
  }

  /** @param {string} message empty takes the error away */
  #fail(message) {
    setText(this.#error, message);
    setAttribute(this.#spec, "aria-invalid", message ? "true" : null);
  }
}

/** @param {number | null} rate */
function rateInWords(rate) {
  return rate === null || rate === 0 ? "not seen" : `${fixed(rate, 0)} Hz`;
}

/** @param {LiveTruthStatus} truth */
function clockInWords({ clock }) {
  if (!clock) return "";
  const drift = clock.drift_ppm === null ? "" : `, drifting by ${fixed(clock.drift_ppm, 0)} ppm`;
  return `Its clock is known to ${fixed(1000 * clock.sigma_s, 1)} ms${drift}, from ${clock.samples} samples.`;
}

customElements.define("observer-live-truth", LiveTruthForm);
