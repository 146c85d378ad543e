/** Calibrations: send one in, see the rectified pair, then use it. */

import { ApiError, request } from "./api.js";
import { describe, previewed } from "./calibration-preview.js";
import { h, icon, setText } from "./dom.js";
import { confirmed, notify, notifyError } from "./notice.js";
import { Part } from "./part.js";

/** @typedef {import("./types.js").Calibration} Calibration */

class CalibrationPanel extends Part {
  #file = h("input", { type: "file", id: "calibration-file", accept: ".yaml,.yml,.xml,.txt", "aria-describedby": "calibration-help calibration-error" });
  #drop = h("div", { class: "drop" });
  #error = h("p", { class: "field-error", id: "calibration-error", role: "alert" });
  #list = h("ul", { class: "item-list" });
  #empty = h("p", { class: "empty" }, "None yet; the source's own calibration is in use.");
  #own = h("button", { class: "button", type: "button" }, "Back to the source's own");
  /** @type {Calibration[]} */
  #all = [];
  #active = "";

  build() {
    this.#drop.append(
      h("label", { for: "calibration-file" }, icon("upload"), "Choose a calibration file, or drop it here"),
      this.#file,
      h("p", { class: "hint", id: "calibration-help" },
        "OpenCV YAML with image_width, image_height, K1, D1, K2, D2, R and T in metres. You see the rectified pair before it is used."),
      this.#error,
    );
    this.#file.addEventListener("change", () => void this.#send(this.#file.files?.[0]));
    this.#own.addEventListener("click", () => void this.#deactivate());
    this.#listenForDrop();
    const make = h("button", { class: "button primary", type: "button" }, "Calibrate cameras");
    make.addEventListener("click", () => this.hub.tell("calibrate"));
    this.append(h("h2", {}, "Calibration"),
      h("p", { class: "hint" }, "With a printed board it takes about five minutes."), h("div", { class: "row" }, make),
      h("h3", {}, "Bring your own"), this.#drop, h("h3", {}, "Kept calibrations"), this.#empty, this.#list, this.#own);
    this.hear("reconnected", () => void this.#load());
    this.hear("calibrations", () => void this.#load());
    this.hear("status", () => {
      const active = this.hub.status?.calibration?.id ?? "";
      if (active === this.#active) return;
      this.#active = active;
      this.#renderList();
    });
    void this.#load();
  }

  #listenForDrop() {
    for (const type of ["dragenter", "dragover"]) {
      this.#drop.addEventListener(type, (event) => {
        event.preventDefault();
        this.#drop.toggleAttribute("data-over", true);
      });
    }
    this.#drop.addEventListener("dragleave", () => this.#drop.removeAttribute("data-over"));
    this.#drop.addEventListener("drop", (event) => {
      event.preventDefault();
      this.#drop.removeAttribute("data-over");
      void this.#send(event.dataTransfer?.files[0]);
    });
  }

  async #load() {
    /** @type {Calibration[] | null} */
    const all = await request("GET", "/calibrations").catch(() => null);
    if (!all) return;
    this.#all = all;
    this.#renderList();
  }

  #renderList() {
    this.#empty.hidden = this.#all.length > 0;
    this.#own.hidden = this.#active === "";
    this.#list.replaceChildren(...this.#all.map((calibration) => this.#item(calibration)));
  }

  /** @param {Calibration} calibration */
  #item(calibration) {
    const active = calibration.id === this.#active;
    const remove = h("button", { type: "button", class: "button icon-button", disabled: active, "aria-label": `Delete calibration ${calibration.name}`, title: active ? "In use" : "Delete" }, icon("trash"));
    const look = h("button", { type: "button", class: "button", "aria-label": `Look at calibration ${calibration.name}` }, "Look");
    remove.addEventListener("click", () => void this.#remove(calibration));
    look.addEventListener("click", () => void this.#look(calibration));
    return h("li", {},
      h("div", { class: "item-words" },
        h("p", {}, h("b", {}, calibration.name), " ", active ? h("span", { class: "state-chip", "data-state": "running" }, "in use") : null),
        h("p", { class: "hint" }, describe(calibration))),
      h("div", { class: "row" }, look, remove));
  }

  /** @param {File | undefined} file */
  async #send(file) {
    if (!file) return;
    setText(this.#error, "");
    const form = new FormData();
    form.append("file", file);
    try {
      /** @type {Calibration} */
      const calibration = await request("POST", "/calibrations", form);
      this.hub.tell("calibrations");
      await this.#look(calibration);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      setText(this.#error, `${file.name} was not taken: ${error.message}`);
    } finally {
      // The same file, corrected, can be chosen again.
      this.#file.value = "";
    }
  }

  /** @param {Calibration} calibration */
  async #look(calibration) {
    const use = await previewed(calibration, calibration.id === this.#active);
    if (!use) return;
    const path = `/calibrations/${encodeURIComponent(calibration.id)}/activate`;
    await this.#change(path, `${calibration.name} is in use.`);
  }

  async #deactivate() {
    await this.#change("/calibrations/deactivate", "The source's own calibration is in use.");
  }

  /**
   * @param {string} path
   * @param {string} done
   */
  async #change(path, done) {
    try {
      /** @type {import("./types.js").Status} */
      const status = await request("POST", path);
      this.hub.takeStatus(status);
      notify(done);
      this.hub.tell("calibrations");
    } catch (error) {
      notifyError(error);
    }
  }

  /** @param {Calibration} calibration */
  async #remove(calibration) {
    const sure = await confirmed(`Delete calibration ${calibration.name}?`, "Runs that used it keep their results.", "Delete calibration");
    if (!sure) return;
    try {
      await request("DELETE", `/calibrations/${encodeURIComponent(calibration.id)}`);
      notify(`Calibration ${calibration.name} deleted.`);
    } catch (error) {
      notifyError(error);
    }
    this.hub.tell("calibrations");
  }
}

customElements.define("observer-calibration", CalibrationPanel);
