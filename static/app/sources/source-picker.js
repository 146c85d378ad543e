/** Choice of the source: those the server offers, and any other by its spec. */

import { button, field, h, onSubmit, setAttribute, setText, textInput } from "../elements/dom.js";
import { KeptList } from "../elements/focus-place.js";
import { Part } from "../elements/part.js";
import { ApiError, request } from "../shell/api.js";
import { notify } from "../shell/notice.js";
import { CameraPicker } from "./camera-picker.js";

/** @import { Calibration } from "../calibration/report-parts.js" */
/** @import { SourceEntry, Status } from "../contract" */

const PLACEHOLDER = /\b[A-Z]{3,}\b/;

class SourcePicker extends Part {
  #list = h("div.source-list", { role: "group", "aria-label": "Sources" });
  #choices = new KeptList(this.#list, (/** @type {SourceEntry} */ choice) => this.#choice(choice));
  #spec = textInput("source-spec", {
    spellcheck: "false",
    "aria-describedby": "source-help source-error",
    required: true,
  });
  #calibration = h("select", { id: "source-calibration" });
  #open = h("button.button.primary", { type: "submit" }, "Open source");
  #error = h("p.field-error", { id: "source-error", role: "alert" });
  #calibrate = button("Calibrate these cameras", () => this.hub.tell("calibrate"), {
    hidden: true,
  });
  #inRun = h("p.hint", { hidden: true }, "Stop the run to open another source.");
  #busy = false;
  #followed = "";

  build() {
    const form = h(
      "form.stack",
      { novalidate: true },
      h(
        "div.field",
        h("label", { for: "source-spec" }, "Source"),
        this.#spec,
        this.#error,
        h(
          "p.hint",
          { id: "source-help" },
          "simulated:SCENARIO, camera:0,1, rtsp://LEFT,rtsp://RIGHT, video:LEFT,RIGHT, coppeliasim:HOST:PORT, or the path of a recording or of a folder with stereo images on the server.",
        ),
      ),
      field("Calibration", this.#calibration),
      h("div.row", this.#open, this.#calibrate, this.#inRun),
    );
    onSubmit(form, () => this.#openSource());
    const cameras = new CameraPicker();
    cameras.chosen = (spec) => {
      this.#spec.value = spec;
      void this.#openSource();
    };
    cameras.attach(this.hub);
    this.append(h("h2", "Source"), this.#list, form, cameras);
    this.hear("status", () => this.#render());
    this.hear("calibrations", () => void this.#loadCalibrations());
    this.hear("reconnected", () => void this.#load());
    void this.#load();
    void this.#loadCalibrations();
  }

  async #load() {
    /** @type {SourceEntry[]} */
    const sources = await request("GET", "/sources").catch(() => []);
    this.#choices.show(sources, ({ spec }) => spec);
    this.#render();
  }

  /** @param {SourceEntry} choice */
  #choice({ spec, title, help }) {
    return button(
      [h("b", title), h("code", spec), h("span", help)],
      () => {
        if (this.#busy) return;
        this.#spec.value = spec;
        // A word in capitals stands for something to be typed, as in video:LEFT,RIGHT.
        if (PLACEHOLDER.test(spec)) this.#spec.select();
        else void this.#openSource();
      },
      { class: "source", "data-spec": spec },
    );
  }

  async #loadCalibrations() {
    /** @type {Calibration[]} */
    const all = await request("GET", "/calibrations").catch(() => []);
    const chosen = this.#calibration.value;
    this.#calibration.replaceChildren(
      h("option", { value: "" }, "The source's own"),
      ...all.map((c) => h("option", { value: c.id }, `${c.name} (${c.width} × ${c.height})`)),
    );
    this.#calibration.value = all.some((c) => c.id === chosen) ? chosen : "";
  }

  #render() {
    const { status } = this.hub;
    const current = status?.source?.spec ?? "";
    // Follow what is open, but never overwrite what is being typed.
    if (current !== this.#followed && document.activeElement !== this.#spec) {
      this.#spec.value = current;
      this.#followed = current;
    }
    const inRun = Boolean(status?.run);
    this.#inRun.hidden = !inRun;
    this.#open.disabled = inRun;
    // Not disabled while it opens: that would take the focus away.
    setAttribute(this.#open, "aria-disabled", this.#busy ? "true" : null);
    for (const button of this.#list.querySelectorAll("button")) {
      setAttribute(button, "aria-current", button.dataset.spec === current ? "true" : null);
      button.disabled = inRun;
      setAttribute(button, "aria-disabled", this.#busy ? "true" : null);
    }
  }

  async #openSource() {
    if (this.#busy) return;
    this.#busy = true;
    this.#fail("");
    this.#offerCalibration(false);
    setText(this.#open, "Opening…");
    this.#render();
    try {
      const source = this.#spec.value.trim();
      /** @type {Status} */
      const status = await request("PUT", "/source", {
        source,
        calibration: this.#calibration.value || null,
      });
      this.#followed = status.source?.spec ?? source;
      this.hub.takeStatus(status);
      notify(`${this.#followed} is open.`);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      this.#fail(error.message);
      this.#offerCalibration(error.message.includes("brings no calibration"));
    } finally {
      this.#busy = false;
      setText(this.#open, "Open source");
      this.#render();
    }
  }

  /** @param {boolean} offered */
  #offerCalibration(offered) {
    this.hub.uncalibrated = offered ? this.#spec.value.trim() : "";
    this.#calibrate.hidden = !offered;
  }

  /** @param {string} message empty takes the error away */
  #fail(message) {
    setText(this.#error, message);
    setAttribute(this.#spec, "aria-invalid", message ? "true" : null);
  }
}

customElements.define("observer-source-picker", SourcePicker);
