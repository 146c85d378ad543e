/** Live motion capture: the stream, the data it delivers, and their alignment. */

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
import { KeyedList } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { fixed, half95, sentence } from "../elements/words.js";
import { request } from "../shell/api.js";
import { attemptIn, notify, exclusiveRunner, showError } from "../shell/notice.js";

/** @import { LiveTruthChoice, LiveTruthStatus } from "../contract" */

/** @type {Record<string, [string, string]>} words and colour of the chip */
const STATES = {
  connecting: ["connecting", "connecting"],
  waiting: ["no body visible", "connecting"],
  receiving: ["receiving", "running"],
};

class LiveTruthForm extends Part {
  #spec = input("text", "live-truth-spec", {
    spellcheck: "false",
    required: true,
    placeholder: "vrpn:HOST",
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
  #bodies = new KeyedList(
    this.#list,
    (/** @type {string} */ name) => this.#body(name),
    () => this.#observer,
  );
  /** @type {Map<string, HTMLElement>} */
  #rates = new Map();
  #choiceError = h("p.field-error", { role: "alert" });
  #heard = h("div.stack", { hidden: true });
  #names = "";
  #followed = "";
  #do = exclusiveRunner(() => this.#render());

  build() {
    const form = h(
      "form.stack",
      { novalidate: true },
      field(
        "Motion-capture stream",
        this.#spec,
        "vrpn:HOST for a VRPN server such as Vicon Tracker's, vicon-udp:51001 for its UDP object stream. It is time-aligned while the robots move, and recorded with every run.",
        this.#error,
      ),
      h("div.row", this.#listen, this.#stop),
    );
    this.#heard.append(
      h("p.row", this.#state),
      this.#trouble,
      this.#sentence,
      this.#clock,
      field("Observer body", this.#observer),
      h("div.named-part", h("span.field-name", "Bodies to compare"), this.#list),
      this.#choiceError,
    );
    this.append(h("h3", "Live motion capture"), form, this.#heard);
    onSubmit(form, () => this.#begin());
    this.#observer.addEventListener("change", () => void this.#choose());
    this.listen("status", () => this.#render());
    this.#render();
  }

  #render() {
    const truth = this.hub.status?.truth ?? null;
    const spec = truth?.spec ?? "";
    // Follow the stream in use, but never overwrite what is being typed.
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

  /** @param {LiveTruthStatus} truth @param {Element | null} [touched] control to leave unchanged */
  #renderBodies({ bodies, observer, ignore }, touched = document.activeElement) {
    const names = [
      ...new Set([...bodies.map(({ name }) => name), ...ignore, ...(observer ? [observer] : [])]),
    ].sort();
    if (names.join("\n") !== this.#names) {
      this.#names = names.join("\n");
      offer(this.#observer, [["", "Detect from motion"], ...names.map((name) => [name, name])]);
    }
    if (touched !== this.#observer) this.#observer.value = observer ?? "";
    this.#bodies.show(names, (name) => name);
    for (const [at, name] of names.entries()) {
      const box = this.#list.children[at]?.querySelector("input");
      if (box && touched !== box) box.checked = !ignore.includes(name);
      const body = bodies.find((each) => each.name === name);
      const rate = this.#rates.get(name);
      if (rate)
        setText(
          rate,
          [body?.role, body ? rateInWords(body.rate_hz) : "not visible"].filter(Boolean).join(", "),
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
    if (!spec)
      return showError(this.#error, "Enter a stream address, for example vrpn:192.168.0.5.");
    const order = { spec, observer: null, ignore: [] };
    await this.#put(order, this.#error, this.#listen, "Connecting…");
  }

  async #end() {
    const order = { spec: null, observer: null, ignore: [] };
    if (await this.#put(order, this.#error, this.#stop, "Stopping…"))
      notify("Stopped listening to motion capture.");
  }

  async #choose() {
    const spec = this.hub.status?.truth?.spec;
    if (!spec) return;
    const left = /** @type {NodeListOf<HTMLInputElement>} */ (
      this.#list.querySelectorAll("input:not(:checked)")
    );
    const order = {
      spec,
      observer: this.#observer.value || null,
      ignore: [...left].map(({ value }) => value),
    };
    if (await this.#put(order, this.#choiceError)) return;
    const { truth } = this.hub.status ?? {};
    if (truth) this.#renderBodies(truth, null);
  }

  /**
   * @param {LiveTruthChoice} order
   * @param {HTMLElement} error shows why it was refused
   * @param {HTMLElement} [button] shows what is going on
   * @param {string} [words]
   * @returns {Promise<boolean>} whether it was accepted
   */
  async #put(order, error, button, words) {
    let taken = false;
    await this.#do(
      async () => {
        taken = await attemptIn(error, async () => {
          /** @type {LiveTruthStatus | null} */
          const truth = await request("PUT", "/truth/live", order);
          this.#followed = truth?.spec ?? "";
          if (this.hub.status) this.hub.applyStatus({ ...this.hub.status, truth });
        });
      },
      button,
      words,
    );
    return taken;
  }
}

/** @param {number | null} rate */
function rateInWords(rate) {
  return rate === null || rate === 0 ? "not visible" : `${fixed(rate, 0)} Hz`;
}

/** @param {LiveTruthStatus} truth */
function clockInWords({ clock }) {
  if (!clock) return "";
  const drift = clock.drift_ppm === null ? "" : `, clock drift ${fixed(clock.drift_ppm, 0)} ppm`;
  return `Time offset known to ± ${fixed(1000 * half95(clock.sigma_s), 1)} ms (95 % interval)${drift}, from ${clock.samples} samples.`;
}

customElements.define("observer-live-truth", LiveTruthForm);
