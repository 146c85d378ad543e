/** Calibrations: send one in, see the rectified pair, then use it. */

import { ApiError, request, requestImage } from "./api.js";
import { h, icon, setText } from "./dom.js";
import { confirmed, notify, notifyError } from "./notice.js";
import { Part } from "./part.js";
import { fixed } from "./words.js";

/** @typedef {import("./types.js").Calibration} Calibration */

const GOOD_PX = 0.5;
const POOR_PX = 1.5;

class CalibrationPanel extends Part {
  #file = h("input", { type: "file", id: "calibration-file", accept: ".yaml,.yml,.xml,.txt", "aria-describedby": "calibration-help calibration-error" });
  #drop = h("div", { class: "drop" });
  #error = h("p", { class: "field-error", id: "calibration-error", role: "alert" });
  #list = h("ul", { class: "item-list" });
  #empty = h("p", { class: "empty" }, "None yet; the source's own calibration is in use.");
  #own = h("button", { class: "button", type: "button" }, "Back to the source's own");
  #preview = h("section", { class: "preview", hidden: true, "aria-label": "Preview of a calibration" });
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
    this.append(h("h2", {}, "Calibration"), this.#drop, this.#preview, h("h3", {}, "Kept calibrations"), this.#empty, this.#list, this.#own);
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
      this.#preview.hidden = true;
      setText(this.#error, `${file.name} was not taken: ${error.message}`);
    } finally {
      // The same file, corrected, can be chosen again.
      this.#file.value = "";
    }
  }

  /** @param {Calibration} calibration */
  async #look(calibration) {
    const canvas = h("canvas", { width: 2, height: 1, role: "img", "aria-label": "The rectified pair, left and right, with level lines across both" });
    const verdict = h("p", { class: "verdict" }, "Rectifying the newest pair…");
    const use = h("button", { type: "button", class: "button primary" }, "Use this calibration");
    const close = h("button", { type: "button", class: "button" }, "Close");
    use.addEventListener("click", () => void this.#use(calibration));
    close.addEventListener("click", () => (this.#preview.hidden = true));
    this.#preview.replaceChildren(
      h("h3", {}, calibration.name),
      h("dl", { class: "figures" }, ...understood(calibration)),
      canvas,
      verdict,
      h("div", { class: "row" }, use, close),
    );
    this.#preview.hidden = false;
    try {
      const { blob, headers } = await requestImage(`/calibrations/${encodeURIComponent(calibration.id)}/preview`);
      const bitmap = await createImageBitmap(blob);
      canvas.width = bitmap.width;
      canvas.height = bitmap.height;
      canvas.getContext("2d")?.drawImage(bitmap, 0, 0);
      bitmap.close();
      const text = headers.get("x-vertical-error-px");
      judgeVertical(verdict, text ? Number(text) : null);
    } catch (error) {
      canvas.hidden = true;
      verdict.dataset.tone = "bad";
      setText(verdict, `No preview: ${error instanceof Error ? error.message : String(error)}`);
    }
  }

  /** @param {Calibration} calibration */
  async #use(calibration) {
    await this.#change(`/calibrations/${encodeURIComponent(calibration.id)}/activate`, `${calibration.name} is in use.`);
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
      await request("POST", path);
      /** @type {import("./types.js").Status} */
      const status = await request("GET", "/status");
      this.hub.takeStatus(status);
      this.#preview.hidden = true;
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
      this.#preview.hidden = true;
      notify(`Calibration ${calibration.name} deleted.`);
    } catch (error) {
      notifyError(error);
    }
    this.hub.tell("calibrations");
  }
}

/** @param {Calibration} c */
function describe(c) {
  return `${c.width} × ${c.height} · baseline ${fixed(c.baseline_m, 3)} m · ${fixed(c.hfov_deg, 1)}° wide`;
}

/** @param {Calibration} c */
function understood(c) {
  /** @type {[string, string][]} */
  const facts = [
    ["Image size", `${c.width} × ${c.height} px`],
    ["Baseline", `${fixed(c.baseline_m, 4)} m`],
    ["Field of view", `${fixed(c.hfov_deg, 1)}° wide`],
    ["Images", c.rectified ? "rectified already" : "rectified by it"],
  ];
  return facts.map(([term, value]) => h("div", {}, h("dt", {}, term), h("dd", { class: "figure" }, value)));
}

/**
 * @param {HTMLElement} verdict
 * @param {number | null} px median vertical error of matches between left and right
 */
function judgeVertical(verdict, px) {
  if (px === null || !Number.isFinite(px)) {
    verdict.dataset.tone = "poor";
    return setText(verdict, "The vertical error could not be measured: too few matches between left and right.");
  }
  const tone = px < GOOD_PX ? "good" : px < POOR_PX ? "poor" : "bad";
  const words = {
    good: "the same point lies on the same line in both images",
    poor: "depth will be noisy; a better calibration is worth the while",
    bad: "this calibration does not fit these cameras",
  }[tone];
  verdict.dataset.tone = tone;
  setText(verdict, `Vertical error ${px.toFixed(2)} px: ${words}.`);
}

customElements.define("observer-calibration", CalibrationPanel);
