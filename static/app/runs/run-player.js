/** A run frame by frame: its left image with what was found in it, and the scene from above. */

import { button, h, input, offerPlayback, select, setAttribute, setText } from "../elements/dom.js";
import { declareKeys, playOnSpace } from "../elements/keys.js";
import { Part } from "../elements/part.js";
import { fixed } from "../elements/words.js";
import { ApiError } from "../shell/api.js";
import { FrameEntries } from "./frame-entries.js";
import { FrameImages } from "./frame-images.js";
import { FramePicture } from "./frame-picture.js";
import { hasImages, isEmpty, methodHref } from "./run-words.js";
import { TopView } from "./top-view.js";

/** @import { FrameEntry, Run } from "../contract" */

declareKeys(
  "Player of a run",
  ["Space", "Play or pause, anywhere on its page, unless a robot is armed"],
  ["← →", "Previous or next frame"],
  ["Home End", "First or last frame"],
);

/** @type {[string, string][]} */
const RATES = [
  ["0.25", "¼ ×"],
  ["0.5", "½ ×"],
  ["1", "1 ×"],
  ["2", "2 ×"],
  ["4", "4 ×"],
];
const MAX_WAITING = 3;
const NO_IMAGES = "This run has no images: the top view shows what was found.";

export class RunPlayer extends Part {
  /** Called with the time shown, s on the run's clock. @type {(time: number) => void} */
  moved = () => {};
  /**
   * Called with what is known of the frame shown, and whether the run had a goal.
   *
   * @type {(entry: FrameEntry | null, goal: boolean) => void}
   */
  shown = () => {};

  #picture = new FramePicture();
  #top = new TopView();
  #stage = h("div.player-stage", this.#picture, this.#top);
  #play = button([], () => this.#setPlaying(!this.#playing), { class: "button icon-button" });
  #slider = input("range", "player-frame", {
    min: 0,
    max: 0,
    step: 1,
    value: 0,
    "aria-label": "Position in the run",
  });
  #place = h("output.figure.position");
  #rate = select({ id: "player-rate", "aria-label": "Playback speed" }, RATES);
  #controls = h("div.player-controls", this.#play, this.#slider, this.#place, this.#rate);
  #method = h("a.player-method", { hidden: true }, "See the method on this frame");
  #note = h("p.hint", { role: "status" });
  /** @type {Run | null} */
  #run = null;
  /** @type {FrameEntries | null} */
  #frames = null;
  /** @type {FrameImages | null} */
  #images = null;
  /** Why there are no images. */
  #trouble = "";
  /** Whether frames or images could not be loaded. */
  #failed = false;
  #at = 0;
  /** Position of the image shown. */
  #drawn = -1;
  #playing = false;
  /** Start of playback: s on the run's clock, ms on the page's. */
  #began = { time: 0, now: 0 };
  /** Number of images being waited for. */
  #waiting = 0;
  #asked = 0;

  build() {
    setAttribute(this, "role", "group");
    setAttribute(this, "aria-label", "Recorded frames");
    this.#rate.value = "1";
    this.append(this.#stage, this.#controls, this.#method, this.#note);
    this.#slider.addEventListener("input", () => this.#stop(this.#slider.valueAsNumber));
    this.#rate.addEventListener("change", () => this.#begin());
    this.addEventListener("keydown", (event) => this.#pressed(event));
    playOnSpace(
      this,
      () => !this.#controls.hidden && this.checkVisibility(),
      () => this.#setPlaying(!this.#playing),
    );
    offerPlayback(this.#play, this.#playing);
    this.#empty("");
    this.listen("reconnected", () => this.#run && this.#failed && this.#load(this.#run));
  }

  /** Position of the frame shown. */
  get position() {
    return this.#at;
  }

  /** @param {Run | null} run null: another view is shown */
  show(run) {
    const before = this.#run;
    this.#run = run;
    if (!run) return this.#setPlaying(false);
    if (run.id !== before?.id) this.#at = 0;
    if (before === null || keyOf(run) !== keyOf(before)) void this.#load(run);
  }

  /** Show the frame at a time pointed at, s on the run's clock. @param {number} time */
  seek(time) {
    if (this.#frames) this.#stop(this.#frames.positionAt(time), false);
  }

  /** @param {Run} run */
  async #load(run) {
    const asked = ++this.#asked;
    this.#setPlaying(false);
    this.#images?.close();
    this.#images = null;
    this.#failed = false;
    if (run.state === "running")
      return this.#empty("The frames are available when the run has ended.");
    if (isEmpty(run)) return this.#empty("This run ended before its first frame.");
    if (run.record === null)
      return this.#empty("This run was not recorded: it has no frames to show.");
    this.#empty("Reading the frames from the recording…", true);
    this.#showNoImages(hasFrameImages(run) ? "" : NO_IMAGES);
    if (hasFrameImages(run)) {
      this.#images = new FrameImages(run.id, Math.max(1, run.frames));
      void this.#showFirst(this.#images);
    }
    try {
      const frames = await FrameEntries.of(run.id);
      if (asked !== this.#asked) return;
      this.#take(frames);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (asked !== this.#asked) return;
      this.#failed = true;
      this.#empty(error.message);
    }
  }

  /**
   * Show the image before what was found in it is loaded.
   *
   * @param {FrameImages} images
   */
  async #showFirst(images) {
    const bitmap = await images.at(this.#at);
    if (images !== this.#images || this.#frames) return bitmap?.close();
    if (!bitmap) return this.#giveUp(images);
    this.#fit(bitmap);
    this.#picture.show(bitmap, null, { width: bitmap.width, height: bitmap.height });
  }

  /**
   * @param {string} words why there is nothing to see
   * @param {boolean} [soon] there will be something: keep its space
   */
  #empty(words, soon = false) {
    this.#frames = null;
    setText(this.#note, words);
    this.#stage.hidden = this.#controls.hidden = !soon;
    this.#method.hidden = true;
    for (const control of this.#controls.querySelectorAll("button, input, select"))
      control.toggleAttribute("disabled", true);
    setText(this.#place, "–");
    this.#picture.show(null, null, { width: 1, height: 1 });
    this.#top.take([]);
    this.shown(null, false);
  }

  /** @param {FrameEntries} frames */
  #take(frames) {
    const { count } = frames;
    if (count === 0) return this.#empty("No frame of this run was recorded.");
    this.#frames = frames;
    this.#stage.hidden = this.#controls.hidden = false;
    for (const control of this.#controls.querySelectorAll("button, input, select"))
      control.toggleAttribute("disabled", false);
    setAttribute(this.#slider, "max", String(count - 1));
    this.#top.take(frames.spread);
    this.#fit(frames.size);
    this.#drawn = -1;
    setText(this.#note, this.#trouble);
    this.#goTo(Math.min(this.#at, count - 1));
  }

  /** Give the stage the shape of the image, as far as it fits. @param {{width: number, height: number}} size */
  #fit({ width, height }) {
    this.#stage.style.setProperty("--aspect", String(width / height));
  }

  /** @param {FrameImages} images that cannot be loaded, or do not exist */
  #giveUp({ trouble }) {
    if (trouble) this.#failed = true;
    this.#showNoImages(trouble || NO_IMAGES);
  }

  /** @param {string} words why there are no images; empty: there are */
  #showNoImages(words) {
    if (words) this.#images = null;
    if (words) this.#method.hidden = true;
    this.#trouble = words;
    this.#picture.hidden = words !== "";
    this.#stage.toggleAttribute("data-alone", words !== "");
    if (this.#frames) setText(this.#note, words);
  }

  /** Stop at a frame. @param {number} position @param {boolean} [tell] */
  #stop(position, tell = true) {
    this.#setPlaying(false);
    this.#goTo(position, tell);
  }

  /**
   * @param {number} position
   * @param {boolean} [tell] false: the caller already knows the time
   */
  #goTo(position, tell = true) {
    const frames = this.#frames;
    if (!frames) return;
    this.#at = position;
    const { count } = frames;
    const time = frames.timeAt(position);
    const words = `${fixed(time, 2)} s`;
    if (this.#slider.valueAsNumber !== position) this.#slider.value = String(position);
    setAttribute(this.#slider, "aria-valuetext", `${words}, frame ${position + 1} of ${count}`);
    setText(this.#place, `${words} · frame ${position + 1} / ${count}`);
    const near = frames.near(position);
    this.#top.show(near, frames.mapAt(position));
    this.shown(near, frames.hasGoal);
    this.#linkMethod(position);
    void this.#showImage(position);
    if (tell) this.moved(time);
    const known = frames.at(position);
    void frames.fetch(position).then((entry) => {
      // Replace the nearest entry with the frame's own.
      if (!known && entry && frames === this.#frames && position === this.#at)
        this.#goTo(position, tell);
    });
  }

  /** Link to the method's steps for this frame and the previous one. @param {number} position */
  #linkMethod(position) {
    const run = this.#run;
    this.#method.hidden = !run || !hasImages(run) || this.#images === null;
    if (run) setAttribute(this.#method, "href", methodHref(run.id, position));
  }

  /** @param {number} position */
  async #showImage(position) {
    const images = this.#images;
    // During playback, drop images that would have to wait.
    if (!images || (this.#playing && this.#waiting >= MAX_WAITING)) return;
    this.#waiting += 1;
    const bitmap = await images.at(position).finally(() => (this.#waiting -= 1));
    const wanted = position === this.#at || (this.#playing && position > this.#drawn);
    if (images !== this.#images || !this.#frames || !wanted) return bitmap?.close();
    if (!bitmap && images.trouble) return this.#giveUp(images);
    this.#drawn = position;
    this.#picture.show(bitmap, this.#frames.at(position), this.#frames.size);
  }

  /** @param {boolean} playing */
  #setPlaying(playing) {
    const frames = this.#frames;
    if (playing === this.#playing || (playing && !frames)) return;
    this.#playing = playing;
    offerPlayback(this.#play, this.#playing);
    if (!playing || !frames) return;
    // At the end, start again.
    if (this.#at >= frames.count - 1) this.#goTo(0);
    this.#drawn = this.#at;
    this.#begin();
    requestAnimationFrame(() => this.#tick());
  }

  #begin() {
    const time = this.#frames?.timeAt(this.#at) ?? 0;
    this.#began = { time, now: performance.now() };
  }

  #tick() {
    const frames = this.#frames;
    if (!this.#playing || !frames || !this.isConnected) return;
    const passed = (performance.now() - this.#began.now) / 1000;
    const at = frames.positionAt(this.#began.time + passed * Number(this.#rate.value));
    if (at !== this.#at) this.#goTo(at);
    if (at >= frames.count - 1) return this.#setPlaying(false);
    requestAnimationFrame(() => this.#tick());
  }

  /** Step by arrow keys from all controls, not just the slider. @param {KeyboardEvent} event */
  #pressed(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target === this.#rate) return;
    const count = this.#frames?.count ?? 0;
    /** @type {Record<string, number>} */
    const places = {
      ArrowLeft: this.#at - 1,
      ArrowRight: this.#at + 1,
      Home: 0,
      End: count - 1,
    };
    const place = places[event.key];
    if (place === undefined || count === 0) return;
    event.preventDefault();
    this.#stop(Math.min(count - 1, Math.max(0, place)));
  }
}

/** Whether its frames have images: a re-run uses those of its original run. @param {Run} run */
function hasFrameImages({ record, rerun_of }) {
  return record !== null && (record !== "none" || rerun_of !== null);
}

/** Return a key of everything the frames and their entries depend on. @param {Run} run */
function keyOf({ id, state, aligned, truth_id }) {
  return [id, state, aligned, truth_id].join(" ");
}

customElements.define("observer-run-player", RunPlayer);
