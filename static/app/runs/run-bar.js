/** Starting and stopping a run, and what the server is doing. */

import {
  button,
  field,
  h,
  icon,
  iconButton,
  input,
  onSubmit,
  select,
  setAttribute,
  setText,
} from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { duration, sentence } from "../elements/words.js";
import { request } from "../shell/api.js";
import { notify, exclusiveRunner } from "../shell/notice.js";
import { RECORDING_CHOICES, runHref, size } from "./run-words.js";

/** @import { RecordingStatus, Status } from "../contract" */

/** @type {Record<string, string>} */
const STATES = {
  connecting: "Connecting",
  closed: "Reconnecting",
  idle: "Idle",
  preview: "Preview",
  running: "Running",
  calibrating: "Calibrating",
  failed: "Failed",
};

class RunBar extends Part {
  #words = h("span");
  #state = h("span.state-chip", this.#words);
  #statePlace = h("span.state-place", this.#state);
  #name = input("text", "run-name", { maxlength: 80, placeholder: "Optional" });
  #record = select({ id: "run-record" }, RECORDING_CHOICES);
  #recording = h("span.record-chip.figure", { hidden: true });
  #start = h(
    "button.button.primary",
    { type: "submit", "aria-label": "Start run" },
    icon("record"),
    h("span", "Start", h("span.run-word", " run")),
  );
  #more = iconButton("more", "Run options", null, { popovertarget: "run-options" });
  #options = h(
    "div.menu-box.run-options",
    { id: "run-options", popover: true },
    field("Run name", this.#name),
    field("Recorded images", this.#record),
    h("p.hint", "Everything else is always recorded."),
  );
  #stop = button([icon("stop"), "Stop run"], () => this.#do(() => this.#end()), {
    class: "button danger",
    hidden: true,
  });
  #time = h("span");
  #runName = h("span.run-name");
  #running = h("span.run-clock.figure", { hidden: true }, this.#time, this.#runName);
  #busy = false;
  /** Whether a button that is disabled or hidden meanwhile had the focus. */
  #focused = false;
  #do = exclusiveRunner((busy) => void this.#changed(busy));
  /** @type {number | null} */
  #restarts = null;

  build() {
    const form = h(
      "form.row",
      this.#recording,
      this.#running,
      h("div.split-button", this.#start, this.#more),
      this.#stop,
      this.#options,
    );
    onSubmit(form, () => this.#do(() => this.#begin()));
    this.append(this.#statePlace, form);
    this.listen("status connection", () => this.#render());
    this.#render();
  }

  #render() {
    const { status, connection } = this.hub;
    // Right after connecting, the first status has not arrived yet.
    const state = connection !== "open" ? connection : (status?.engine.state ?? "connecting");
    setText(this.#words, STATES[state] ?? state);
    setAttribute(this.#state, "data-state", state);
    setAttribute(this.#state, "title", status?.engine.reason ?? null);
    if (status) this.#notifyRestart(status.engine.restarts);
    const run = status?.run ?? null;
    this.#renderRecording(status?.recording ?? null);
    this.#start.hidden = this.#more.hidden = run !== null;
    this.#stop.hidden = run === null;
    this.#running.hidden = run === null;
    // Duration first, because a long name is cut off.
    setText(this.#time, run ? duration(run.duration_s) : "");
    setText(this.#runName, run ? ` · ${run.name}` : "");
    setAttribute(this.#running, "title", run?.name ?? null);
    const ready = connection === "open" && !this.#busy;
    this.#start.disabled = !ready || !status?.source || status.engine.state === "calibrating";
    this.#stop.disabled = !ready;
  }

  /** @param {RecordingStatus | null} recording */
  #renderRecording(recording) {
    this.#recording.hidden = recording === null;
    if (!recording) return;
    const { images, bytes, dropped, trouble } = recording;
    const lost = dropped > 0 ? `, ${dropped} dropped` : "";
    setText(
      this.#recording,
      trouble
        ? "Not recording"
        : `Recording ${size(bytes)}${images === "none" ? ", no images" : ""}${lost}`,
    );
    setAttribute(this.#recording, "data-trouble", trouble || dropped > 0 ? "" : null);
    setAttribute(
      this.#recording,
      "title",
      trouble ? sentence(trouble) : dropped > 0 ? "The disk could not keep up." : null,
    );
  }

  /** @param {number} restarts since the server was started */
  #notifyRestart(restarts) {
    const before = this.#restarts;
    this.#restarts = restarts;
    if (before === null || restarts <= before) return;
    notify("The engine stopped and was restarted. A new segment begins here.", "error");
  }

  async #begin() {
    const name = this.#name.value.trim();
    await request("POST", "/runs", {
      ...(name ? { name } : {}),
      record: this.#record.value,
    });
    this.#name.value = "";
    this.hub.emit("runs");
  }

  async #end() {
    const run = this.hub.status?.run;
    if (!run) return;
    await request("POST", `/runs/${encodeURIComponent(run.id)}/stop`);
    notify(`Run “${run.name}” stopped and saved.`, "done", {
      words: "Open run",
      act: () => (location.hash = runHref(run.id)),
    });
    this.hub.emit("runs");
  }

  /** @param {boolean} busy */
  async #changed(busy) {
    if (busy) this.#focused = this.contains(document.activeElement);
    this.#busy = busy;
    this.#render();
    if (busy) return;
    const status = await request("GET", "/status").catch(() => null);
    if (status) this.hub.applyStatus(/** @type {Status} */ (status));
    if (this.#focused && document.activeElement === document.body)
      (this.#stop.hidden ? this.#start : this.#stop).focus();
  }
}

customElements.define("observer-run-bar", RunBar);
