/** The second step: the board is moved, and its views are captured. */

import { request } from "../api.js";
import { h, icon, setAttribute, setText } from "../dom.js";
import { LiveView } from "../live-view.js";
import { notifyError } from "../notice.js";
import { Part } from "../part.js";
import { CoverQuestion } from "./cover-question.js";

/** @type {[string, string][]} names of the bars and what fills them */
const BARS = [
  ["X", "Left and right"],
  ["Y", "Up and down"],
  ["Size", "Near and far"],
  ["Skew", "Tilt"],
];

export class CaptureStep extends Part {
  /** Called when the views shall be computed. */
  compute = () => {};

  #words = h("p", { class: "capture-words", role: "status", "aria-live": "polite" });
  #next = h("p", { class: "capture-next" });
  #cameras = h("div", { class: "capture-cameras" });
  #bars = new Map(BARS.map(([name, words]) => [name, bar(words)]));
  #capture = h("button", { class: "button", type: "button" }, "Capture now");
  #undo = h("button", { class: "button", type: "button" }, icon("undo"), "Undo");
  #automatic = h("input", { type: "checkbox", id: "capture-automatic" });
  #compute = h("button", { class: "button primary", type: "button" }, "Compute the calibration");
  #cancel = h("button", { class: "button", type: "button" }, "Cancel");
  #progress = h("progress", { max: 1, "aria-label": "Computing" });
  #progressWords = h("span", { role: "status" });
  #computing = h("div", { class: "row", hidden: true }, this.#progress, this.#progressWords, this.#cancel);
  #trouble = h("p", { class: "field-error", role: "alert" });
  #count = h("h3", {}, "No views yet");
  #list = h("ul", { class: "view-list" });
  #refused = h("details", { hidden: true });
  #cover = new CoverQuestion();
  #shown = false;
  #names = "";

  build() {
    this.#cover.attach(this.hub);
    const controls = h("div", { class: "row" }, this.#capture, this.#undo,
      h("label", { class: "check", for: "capture-automatic" }, this.#automatic, "Capture by itself"));
    this.append(
      h("div", { class: "capture-main" }, this.#words, this.#next, this.#cameras, controls),
      h("div", { class: "capture-side" },
        h("h3", {}, "What is covered"),
        h("dl", { class: "coverage" }, ...this.#bars.values()),
        this.#compute, this.#computing, this.#trouble,
        this.#cover, this.#count, this.#list, this.#refused));
    this.#capture.addEventListener("click", () => void this.#change({ capture: true }));
    this.#undo.addEventListener("click", () => void this.#change({ undo: true }));
    this.#automatic.addEventListener("change", () => void this.#change({ automatic: this.#automatic.checked }));
    this.#compute.addEventListener("click", () => this.compute());
    this.#cancel.addEventListener("click", () => void request("POST", "/calibrating/cancel").catch(notifyError));
    this.hear("status", () => this.#render());
  }

  /** @param {boolean} shown whether this step is to be seen; the cameras are watched only then */
  show(shown) {
    this.hidden = !shown;
    if (shown === this.#shown) return;
    this.#shown = shown;
    this.#cameras.replaceChildren();
    if (!shown) return;
    this.#cameras.replaceChildren(...["camera_left", "camera_right"].map((name) => {
      const view = new LiveView();
      view.name = name;
      view.attach(this.hub);
      return view;
    }));
    this.#render();
  }

  #render() {
    const now = this.hub.status?.calibrating;
    if (!this.#shown || !now) return;
    const live = now.source !== null;
    const trouble = this.hub.status?.live?.trouble ?? null;
    for (const part of [this.#words, this.#next, this.#cameras, this.#capture.parentElement, this.#cover]) {
      if (part) part.hidden = !live;
    }
    setText(this.#words, trouble ?? now.look?.words ?? "Waiting for the first image.");
    setText(this.#next, now.look?.next ?? "");
    for (const [name, row] of this.#bars) fill(row, now.look?.coverage?.[name] ?? 0);
    this.#automatic.checked = now.automatic;
    this.#undo.disabled = now.views.length === 0;
    const busy = now.computing !== null;
    this.#compute.disabled = busy || now.views.length === 0;
    setAttribute(this.#compute, "data-enough", now.look?.enough ? "" : null);
    this.#computing.hidden = !busy;
    if (now.computing) {
      this.#progress.value = now.computing.share;
      setText(this.#progressWords, now.computing.words);
    }
    setText(this.#trouble, now.trouble ?? "");
    this.#renderViews(now);
  }

  /** @param {import("../types.js").Calibrating} now */
  #renderViews(now) {
    const names = JSON.stringify([now.views, now.refused]);
    if (names === this.#names) return;
    this.#names = names;
    const count = now.views.length;
    setText(this.#count, count === 0 ? "No views yet" : count === 1 ? "1 view" : `${count} views`);
    this.#list.replaceChildren(...now.views.map((view) => this.#item(view)));
    this.#refused.hidden = now.refused.length === 0;
    this.#refused.replaceChildren(
      h("summary", {}, `${now.refused.length} images were not used`),
      h("ul", { class: "plain-list" }, ...now.refused.map((reason) => h("li", {}, reason))));
  }

  /** @param {import("../types.js").CapturedView} view */
  #item(view) {
    const remove = h("button", { class: "quiet", type: "button", "aria-label": `Remove view ${view.name}`, title: "Remove" }, icon("close"));
    remove.addEventListener("click", () => void this.#change({ remove: view.name }));
    const path = `/api/calibrating/views/${encodeURIComponent(view.name)}`;
    const picture = view.picture
      ? h("img", { src: `${path}/left.jpg`, alt: "", width: 80, loading: "lazy" })
      : null;
    const seen = view.left && view.right ? "" : view.left ? "left only" : "right only";
    return h("li", {}, picture, h("span", {}, h("b", {}, view.name), " ", seen), remove);
  }

  /** @param {Record<string, unknown>} change */
  async #change(change) {
    try {
      const { calibrating } = /** @type {{calibrating: import("../types.js").Calibrating}} */ (
        await request("PATCH", "/calibrating", change));
      const { status } = this.hub;
      if (status) this.hub.takeStatus({ ...status, calibrating });
    } catch (error) {
      notifyError(error);
    }
  }
}

/** @param {string} words */
function bar(words) {
  return h("div", {}, h("dt", {}, words), h("dd", {}, h("meter", { min: 0, max: 1, value: 0, "aria-label": words })));
}

/** @param {HTMLElement} row @param {number} share */
function fill(row, share) {
  const meter = row.querySelector("meter");
  if (meter) meter.value = share;
  row.toggleAttribute("data-full", share >= 1);
}

customElements.define("observer-capture-step", CaptureStep);
