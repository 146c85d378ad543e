/** Choice of the source: those the server offers, and any other by its spec. */

import { button, field, h, input, offer, onSubmit, setAttribute } from "../elements/dom.js";
import { KeptList } from "../elements/focus-place.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { notify, oneAtATime } from "../shell/notice.js";
import { CameraPicker } from "./camera-picker.js";

/** @import { Calibration } from "../calibration/report-parts.js" */
/** @import { SourceEntry, Status } from "../contract" */

const PLACEHOLDER = /\b[A-Z]{3,}\b/;

class SourcePicker extends Part {
  #list = h("div.source-list", { role: "group", "aria-label": "Sources" });
  #choices = new KeptList(this.#list, (/** @type {SourceEntry} */ choice) => this.#choice(choice));
  #spec = input("text", "source-spec", {
    spellcheck: "false",
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
  #do = oneAtATime((busy) => {
    this.#busy = busy;
    this.#render();
  }, this.#error);
  #followed = "";

  build() {
    const form = h(
      "form.stack",
      { novalidate: true },
      field(
        "Source",
        this.#spec,
        "simulated:SCENARIO, camera:0,1, rtsp://LEFT,rtsp://RIGHT, video:LEFT,RIGHT, coppeliasim:HOST:PORT, or the path on the server of a recording or of a folder with stereo images.",
        this.#error,
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
    this.hear("calibrations", () => this.#loadCalibrations());
    this.hear("reconnected", () => this.#load());
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
    offer(this.#calibration, [
      ["", "The source's own"],
      ...all.map((c) => [c.id, `${c.name} (${c.width} × ${c.height})`]),
    ]);
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
    this.#offerCalibration(false);
    const opened = await this.#do(
      async () => {
        const source = this.#spec.value.trim();
        /** @type {Status} */
        const status = await request("PUT", "/source", {
          source,
          calibration: this.#calibration.value || null,
        });
        this.#followed = status.source?.spec ?? source;
        this.hub.takeStatus(status);
        notify(`${this.#followed} is open.`);
      },
      this.#open,
      "Opening…",
    );
    if (!opened)
      this.#offerCalibration(this.#error.textContent?.includes("brings no calibration") ?? false);
  }

  /** @param {boolean} offered */
  #offerCalibration(offered) {
    this.hub.uncalibrated = offered ? this.#spec.value.trim() : "";
    this.#calibrate.hidden = !offered;
  }
}

customElements.define("observer-source-picker", SourcePicker);
