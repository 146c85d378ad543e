/** The second step: capture views while the board is moved. */

import { button, h, icon, input, setAttribute, setText } from "../elements/dom.js";
import { KeyedList, moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { counted } from "../elements/words.js";
import { LiveView } from "../live/live-view.js";
import { request } from "../shell/api.js";
import { attempt, notify, notifyError } from "../shell/notice.js";
import { CoverCheck } from "./cover-check.js";

/** @import { CalibratingFacts, CapturedView } from "../contract" */

/** @type {[string, string][]} names of the bars and what fills them */
const BARS = [
  ["X", "Left and right"],
  ["Y", "Up and down"],
  ["Size", "Near and far"],
  ["Skew", "Tilt"],
];

// The instruction changes with every image: it is updated only as fast as it can be read from two
// metres away, and announced more slowly still.
const SHOWN_FOR_MS = 350;
const CAPTURED_FOR_MS = 1300;
const SPOKEN_EVERY_MS = 6000;

export class CaptureStep extends Part {
  /** Called to compute the calibration from the views. */
  compute = () => {};
  /** True if the last computation was cancelled from this page. */
  cancelled = false;

  #words = h("p.capture-words");
  #spoken = h("p.visually-hidden", { role: "status", "aria-live": "polite" });
  #next = h("p.capture-next");
  #cameras = h("div.capture-cameras");
  #bars = new Map(BARS.map(([name, words]) => [name, bar(words)]));
  #covered = h("div.stack", h("h3", "Coverage"), h("dl.coverage", ...this.#bars.values()));
  #capture = button("Capture now", () => this.#change({ capture: true }));
  #undo = button([icon("undo"), "Undo"], () => this.#change({ undo: true }));
  #automatic = input("checkbox", "capture-automatic");
  #compute = button("Compute calibration", () => this.compute(), { class: "button primary" });
  #cancel = button("Cancel", () => this.#end());
  #progress = h("progress", { max: 1, "aria-label": "Computing" });
  #progressWords = h("span", { role: "status" });
  #computing = h("div.row", { hidden: true }, this.#progress, this.#progressWords, this.#cancel);
  #trouble = h("p.field-error", { role: "alert" });
  #count = h("h3", "No views yet");
  #list = h("ul.view-list", { "aria-label": "Captured views" });
  #items = new KeyedList(
    this.#list,
    (/** @type {CapturedView} */ view) => this.#item(view),
    () => this.#capture,
  );
  #refused = h("details", { hidden: true });
  #cover = new CoverCheck();
  #shown = false;
  #refusals = "";
  /** Names of the views; null until they are known. @type {Set<string> | null} */
  #known = null;
  #heldUntil = 0;
  #spokenAt = -Infinity;
  #changing = 0;

  build() {
    this.#cover.attach(this.hub);
    const controls = h(
      "div.row.capture-controls",
      this.#capture,
      this.#undo,
      h("label.check", { for: "capture-automatic" }, this.#automatic, "Capture automatically"),
    );
    this.append(
      h("div.capture-main", this.#words, this.#next, this.#spoken, this.#cameras, controls),
      h(
        "div.capture-side",
        this.#covered,
        this.#compute,
        this.#computing,
        this.#trouble,
        this.#cover,
        this.#count,
        this.#list,
        this.#refused,
      ),
    );
    this.#automatic.addEventListener(
      "change",
      () => void this.#change({ automatic: this.#automatic.checked }),
    );
    this.listen("status", () => this.#render());
  }

  /** @param {boolean} shown whether this step is visible; only then are the cameras shown */
  show(shown) {
    this.hidden = !shown;
    if (shown === this.#shown) return;
    this.#shown = shown;
    this.#cameras.replaceChildren();
    if (!shown) return;
    this.#cameras.replaceChildren(
      ...["camera_left", "camera_right"].map((name) => {
        const view = new LiveView();
        view.name = name;
        view.attach(this.hub);
        return view;
      }),
    );
    this.#render();
  }

  #render() {
    const now = this.hub.status?.calibrating;
    if (!this.#shown || !now) return;
    const live = now.source !== null;
    const trouble = this.hub.status?.live?.trouble ?? null;
    // With uploaded images there is no board to hold, no view to watch and no lens to cover.
    for (const part of [this.#words.parentElement, this.#covered, this.#cover]) {
      if (part) part.hidden = !live;
    }
    this.toggleAttribute("data-sent-in", !live);
    this.#say(now, trouble);
    const { width, height } = this.hub.status?.source ?? {};
    if (width && height) this.#cameras.style.setProperty("--camera", `${width} / ${height}`);
    for (const [name, row] of this.#bars) fill(row, now.look?.coverage?.[name] ?? 0);
    // Until the request is answered, an older status would undo the change.
    if (this.#changing === 0) this.#automatic.checked = now.automatic;
    if (now.views.length === 0) moveFocus(this.#undo, this.#capture);
    this.#undo.disabled = now.views.length === 0;
    this.#renderComputing(now);
    setAttribute(this.#compute, "data-enough", now.look?.enough ? "" : null);
    setText(this.#trouble, now.trouble ?? "");
    this.#renderViews(now);
  }

  /** @param {CalibratingFacts} now */
  #renderComputing({ computing, views }) {
    if (computing) {
      this.#computing.hidden = false;
      moveFocus(this.#compute, this.#cancel);
      this.#progress.value = computing.share;
      setText(this.#progressWords, computing.words);
    }
    this.#compute.disabled = computing !== null || views.length === 0;
    if (!computing) {
      moveFocus(this.#computing, this.#compute, this.#capture);
      this.#computing.hidden = true;
    }
  }

  /**
   * Say what to do now. The message about a captured view stays long enough to be read, and
   * unchanged words are not announced again.
   *
   * @param {CalibratingFacts} now
   * @param {string | null} trouble what is wrong with the cameras
   */
  #say({ look, views, computing }, trouble) {
    const added = this.#known
      ? views.filter(({ name }) => !this.#known?.has(name)).at(-1)
      : undefined;
    this.#known = new Set(views.map(({ name }) => name));
    const next = computing ? "" : (look?.next ?? "");
    // The next place is shown below; do not say it twice.
    const asked = look?.words.startsWith("Already captured") ? "Already captured" : look?.words;
    const usual = computing ? "Computing the calibration" : asked;
    const captured = added && `Captured ${added.name}${look?.enough ? "; enough views" : ""}`;
    const words = trouble ?? captured ?? usual ?? "Waiting for the first image";
    const time = performance.now();
    const urgent = Boolean(added || trouble);
    if (words !== this.#words.textContent && (urgent || time > this.#heldUntil)) {
      setText(this.#words, words);
      this.#heldUntil = time + (added ? CAPTURED_FOR_MS : SHOWN_FOR_MS);
    }
    setText(this.#next, next);
    const spoken = captured ? `${captured}. ${next}` : (trouble ?? (next || words));
    if (added || time - this.#spokenAt > SPOKEN_EVERY_MS) {
      this.#spokenAt = time;
      setText(this.#spoken, spoken);
    }
  }

  /** @param {CalibratingFacts} now */
  #renderViews(now) {
    const count = now.views.length;
    setText(this.#count, count === 0 ? "No views yet" : counted(count, "view"));
    this.#items.show(now.views, (view) => view.name);
    const refusals = JSON.stringify(now.refused);
    if (refusals === this.#refusals) return;
    this.#refusals = refusals;
    this.#refused.hidden = now.refused.length === 0;
    this.#refused.replaceChildren(
      h("summary", `${counted(now.refused.length, "image")} not used`),
      h("ul.plain-list", ...now.refused.map((reason) => h("li", reason))),
    );
  }

  /** @param {CapturedView} view */
  #item(view) {
    const remove = button(icon("close"), () => this.#change({ remove: view.name }), {
      class: "quiet",
      "aria-label": `Remove view ${view.name}`,
      title: "Remove",
    });
    const path = `/api/calibrating/views/${encodeURIComponent(view.name)}`;
    const picture = view.picture ? h("img", { src: `${path}/left.jpg`, alt: "", width: 80 }) : null;
    const seen = view.left && view.right ? "" : view.left ? "left only" : "right only";
    return h("li", picture, h("span", h("b", view.name), " ", seen), remove);
  }

  async #end() {
    this.cancelled = true;
    await attempt(async () => {
      await request("POST", "/calibrating/cancel");
      notify("Computation cancelled. The captured views are kept.");
    });
  }

  /** @param {Record<string, unknown>} change */
  async #change(change) {
    this.#changing += 1;
    try {
      const { calibrating } = /** @type {{calibrating: CalibratingFacts}} */ (
        await request("PATCH", "/calibrating", change)
      );
      const { status } = this.hub;
      this.#changing -= 1;
      if (status) this.hub.applyStatus({ ...status, calibrating });
    } catch (error) {
      this.#changing -= 1;
      notifyError(error);
    }
  }
}

/** @param {string} words */
function bar(words) {
  return h(
    "div",
    h("dt", words),
    h("dd", h("meter", { min: 0, max: 1, value: 0, "aria-label": words })),
  );
}

/** @param {HTMLElement} row @param {number} share */
function fill(row, share) {
  const meter = row.querySelector("meter");
  if (meter) meter.value = share;
  row.toggleAttribute("data-full", share >= 1);
}

customElements.define("observer-capture-step", CaptureStep);
