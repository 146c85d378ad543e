/** Playback of files and simulation: pause, step, restart, rate, loop and position. */

import {
  button,
  h,
  iconButton,
  input,
  offerPlayback,
  setAttribute,
  setText,
} from "../elements/dom.js";
import { FASTEST_RATE, SLOWEST_RATE } from "../elements/facts.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { attemptIn } from "../shell/notice.js";
import { ScrubBar } from "./scrub-bar.js";

/** @import { PlaybackStatus } from "../contract" */

const SLIDER_STEPS = 100;
const SEND_EVERY_MS = 150;

class PlaybackBar extends Part {
  #pause = button([], () => this.#send({ paused: !this.#paused }), { class: "button icon-button" });
  #step = iconButton("step", "Step forward", () => this.#send({ paused: true, step: 1 }), {
    title: "Step forward one frame (pauses playback)",
  });
  #restart = iconButton("restart", "Restart from the first frame", () =>
    this.#send({ restart: true }),
  );
  #slider = input("range", "rate-slider", {
    min: 0,
    max: SLIDER_STEPS,
    step: 1,
    "aria-label": "Playback rate",
  });
  #number = input("number", "rate", {
    min: SLOWEST_RATE,
    max: FASTEST_RATE,
    step: 0.1,
    "aria-label": "Playback rate, times recorded speed",
  });
  #loop = input("checkbox", "loop");
  #scrub = new ScrubBar();
  #progress = h("progress", { max: 1, value: 0, "aria-label": "Position" });
  #position = h("output.figure.position", "–");
  #live = h("p.hint", { hidden: true }, "This source is live; it cannot be paused.");
  #controls = h("div.playback-controls");
  #error = h("p.field-error.playback-error", { role: "alert" });
  #sendTimer = 0;
  #paused = false;
  #holdRateUntil = 0;

  build() {
    setAttribute(this, "role", "group");
    setAttribute(this, "aria-label", "Playback");
    this.#loop.addEventListener("change", () => void this.#send({ loop: this.#loop.checked }));
    this.#slider.addEventListener("input", () =>
      this.#rateChanged(rateAt(this.#slider.valueAsNumber)),
    );
    this.#number.addEventListener("change", () => this.#numberChanged());
    this.#controls.append(
      h("div.row", this.#restart, this.#pause, this.#step),
      h(
        "div.row.rate",
        h("label", { for: "rate" }, "Rate"),
        this.#slider,
        this.#number,
        h("span.unit", "×"),
      ),
      h("label.check", this.#loop, "Loop"),
      h("div.row.where", this.#scrub, this.#progress, this.#position),
    );
    this.#scrub.error = this.#error;
    this.#scrub.attach(this.hub);
    this.append(this.#error, this.#controls, this.#live);
    this.listen("status", () => this.#render());
    this.listen("observation", () => this.#renderPosition());
    this.#render();
  }

  #render() {
    const { status } = this.hub;
    const playback = status?.playback ?? null;
    const live = status?.source?.live ?? false;
    this.#live.hidden = !live;
    this.#controls.hidden = live;
    for (const control of this.#controls.querySelectorAll("button, input")) {
      control.toggleAttribute("disabled", playback === null);
    }
    this.#paused = playback?.paused ?? false;
    offerPlayback(this.#pause, !this.#paused);
    if (playback) {
      this.#loop.checked = playback.loop;
      if (performance.now() > this.#holdRateUntil) this.#showRate(playback.rate);
    }
    this.toggleAttribute("data-seekable", playback?.seekable ?? false);
    this.#renderPosition();
  }

  #renderPosition() {
    const playback = this.hub.status?.playback;
    if (!playback) return setText(this.#position, "–");
    const share = shareOf(playback);
    // If the source is seekable, the slider shows the position as well.
    this.#progress.hidden = share === null || playback.seekable;
    if (share !== null) this.#progress.value = share;
    setText(this.#position, `${positionInWords(playback)}${slownessInWords(playback)}`);
  }

  /** @param {number} rate */
  #showRate(rate) {
    if (document.activeElement !== this.#number)
      this.#number.value = String(Number(rate.toFixed(2)));
    if (document.activeElement !== this.#slider) this.#slider.value = String(placeOf(rate));
    this.#slider.setAttribute("aria-valuetext", `${rate.toFixed(2)} times recorded speed`);
  }

  #numberChanged() {
    const rate = this.#number.valueAsNumber;
    if (Number.isFinite(rate))
      this.#rateChanged(Math.min(FASTEST_RATE, Math.max(SLOWEST_RATE, rate)));
    else this.#showRate(this.hub.status?.playback?.rate ?? 1);
  }

  /** @param {number} rate */
  #rateChanged(rate) {
    this.#number.value = String(rate);
    this.#slider.value = String(placeOf(rate));
    this.#slider.setAttribute("aria-valuetext", `${rate} times recorded speed`);
    // The server's status still has the old rate for a moment.
    this.#holdRateUntil = performance.now() + 1000;
    clearTimeout(this.#sendTimer);
    this.#sendTimer = setTimeout(() => void this.#send({ rate }), SEND_EVERY_MS);
  }

  /** @param {object} change */
  async #send(change) {
    const done = await attemptIn(this.#error, async () => {
      /** @type {PlaybackStatus} */
      const playback = await request("POST", "/playback", change);
      if (this.hub.status) this.hub.applyStatus({ ...this.hub.status, playback });
    });
    if (done) return;
    this.#holdRateUntil = 0;
    this.#render();
  }
}

/**
 * Return the share of the source that has been played; null where it has no known end.
 *
 * While a robot in it is armed, a simulation continues beyond its last frame: null then as well.
 *
 * @param {Pick<PlaybackStatus, "frame" | "frame_count">} playback
 */
export function shareOf({ frame, frame_count: count }) {
  return count && (frame ?? 0) < count ? ((frame ?? -1) + 1) / count : null;
}

/** @param {Pick<PlaybackStatus, "frame" | "frame_count">} playback @returns {string} as in "frame 3 / 900" */
export function positionInWords(playback) {
  const of = shareOf(playback) === null ? "" : ` / ${playback.frame_count}`;
  return `frame ${playback.frame ?? "–"}${of}`;
}

/**
 * Say how fast it plays if the computer does not keep up; no frame is dropped.
 *
 * @param {PlaybackStatus} playback
 */
function slownessInWords({ paused, ended, rate, achieved_rate: achieved }) {
  if (paused || ended || !achieved || achieved > 0.9 * rate) return "";
  return `, at ${achieved.toFixed(2)} ×`;
}

/** @param {number} place on the slider, whose scale is logarithmic @returns {number} rate */
function rateAt(place) {
  const rate = SLOWEST_RATE * (FASTEST_RATE / SLOWEST_RATE) ** (place / SLIDER_STEPS);
  // Snap to the recorded speed.
  return Math.abs(rate - 1) < 0.04 ? 1 : Number(rate.toFixed(2));
}

/** @param {number} rate */
function placeOf(rate) {
  return Math.round(
    (SLIDER_STEPS * Math.log(rate / SLOWEST_RATE)) / Math.log(FASTEST_RATE / SLOWEST_RATE),
  );
}

customElements.define("observer-playback", PlaybackBar);
