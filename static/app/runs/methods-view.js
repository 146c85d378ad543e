/** Comparing two methods on identical frames: choices, progress and result. */

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
import { COMPARISON_TAG } from "../elements/facts.js";
import { moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { sentence, when } from "../elements/words.js";
import { access } from "../shell/access.js";
import { ApiError, request, requestImage } from "../shell/api.js";
import { attemptIn, exclusiveRunner } from "../shell/notice.js";
import { MethodsSplit } from "./methods-split.js";
import { methodNames, methodsHref, positionOf, sameFrames, timeLeft } from "./methods-words.js";
import { compareHref, hasImages } from "./run-words.js";

/** @import { ComparisonStatus, History, Run, RunFrames, SourceEntry } from "../contract" */

const ASK_EVERY_MS = 400;
// The default for newcomers: walking people seen from a moving robot.
const FIRST = "simulated:people";
const OPEN = "open";
const MAX_LISTED = 40;

export class MethodsView extends Part {
  #source = h("select", { id: "methods-source" });
  #seconds = input("number", "methods-seconds", { min: 1, max: 30, step: 1, value: 8 });
  #begin = h("button.button.primary", { type: "submit" }, "Compare methods");
  #form = h("form.methods-form", { novalidate: true });
  #error = h("p.field-error", { id: "methods-error", role: "alert" });
  #bar = h("progress", { max: 1, "aria-label": "Comparison" });
  #picture = h("img", { alt: "", width: 1024, height: 256 });
  // No status role: it changes with every frame, too often for screen readers.
  #words = h("p.figure");
  #cancel = button("Cancel", () => this.#cancelled());
  #going = h("div.methods-progress", { hidden: true });
  #waiting = h("p.empty", { role: "status" });
  /** Above the result of an earlier comparison while another one is made. */
  #before = h("h3", { hidden: true }, "Earlier comparison");
  #split = new MethodsSplit();
  #more = h("p.row");
  #earlier = h("ul.plain-list");
  #earlierPart = h("details", { hidden: true }, h("summary", "Earlier comparisons"), this.#earlier);
  #shown = false;
  /** @type {string[]} */
  #ids = [];
  /** Whether something could not be read. */
  #failed = false;
  #asked = 0;
  #timer = 0;
  /** When the comparison in progress was first seen, ms, and how far it was then. */
  #began = { at: 0, share: 1 };
  #do = exclusiveRunner(
    (busy) => setAttribute(this.#begin, "aria-disabled", busy ? "true" : null),
    this.#error,
  );

  build() {
    for (const each of [this.#source, this.#seconds])
      setAttribute(each, "aria-describedby", this.#error.id);
    this.#form.append(
      field("Frames from", this.#source),
      field("Seconds", this.#seconds),
      this.#begin,
    );
    this.#going.append(this.#bar, this.#words, this.#cancel, this.#picture);
    this.append(
      h(
        "p.hint",
        "The same frames are processed with paper, the published method, and with default. The current source is not affected.",
      ),
      this.#form,
      this.#error,
      this.#going,
      this.#waiting,
      this.#before,
      this.#split,
      this.#more,
      this.#earlierPart,
    );
    this.#split.attach(this.hub);
    this.#split.hidden = true;
    onSubmit(this.#form, () => this.#start());
    this.listen("reconnected", () => this.#resume());
    this.listen("hashchange", () => this.#follow(), window);
  }

  /** @param {string[] | null} ids of two runs; empty: the newest two; null: another view is open */
  show(ids) {
    this.hidden = ids === null;
    this.#shown = ids !== null;
    this.#ids = ids ?? [];
    clearTimeout(this.#timer);
    this.#asked += 1;
    this.#split.show([]);
    this.#more.replaceChildren();
    setText(this.#waiting, "");
    setText(this.#error, "");
    if (!ids) return;
    void this.#open();
  }

  /** Go to the frame in the page's address after the user changed it. */
  #follow() {
    const position = positionOf(location.hash);
    if (this.#shown && position !== null) this.#split.goTo(position);
  }

  /** Continue now that the server is back; what could not be read is read again. */
  #resume() {
    if (!this.#shown) return;
    if (!this.#failed) return void this.#ask();
    this.#asked += 1;
    void this.#open();
  }

  async #open() {
    const asked = this.#asked;
    this.#failed = false;
    const done = await attemptIn(this.#error, async () => {
      if (this.#ids.length === 2) void this.#load();
      const [granted] = await Promise.all([access(), this.#connected()]);
      const [status, listed, sources] = await Promise.all([
        /** @type {Promise<ComparisonStatus>} */ (request("GET", "/comparison")),
        /** @type {Promise<History>} */ (request("GET", `/history?limit=${MAX_LISTED}`)),
        /** @type {Promise<SourceEntry[]>} */ (request("GET", "/sources")),
      ]);
      if (asked !== this.#asked) return;
      this.#offerSources(sources, listed.runs);
      const pairs = pairsOf(listed.runs);
      this.#list(pairs);
      this.#showStatus(status);
      if (status.going || this.#ids.length === 2) return;
      const newest = pairs[0]?.map(({ id }) => id);
      if (newest) location.replace(methodsHref(newest));
      else if (granted === "operator" && this.#mayStartUnasked) await this.#start();
    });
    if (asked === this.#asked && !done) this.#failed = true;
  }

  /** Wait for the first status from the server. */
  async #connected() {
    if (this.hub.status) return;
    await new Promise((resolve) => {
      this.hub.addEventListener("status", resolve, { once: true });
    });
  }

  /** Whether nothing is going on that the first comparison could slow down. */
  get #mayStartUnasked() {
    const { status, driver } = this.hub;
    return Boolean(status?.source && !status.source.live && !status.run && !driver.anyArmed);
  }

  /** @param {SourceEntry[]} sources @param {Run[]} runs */
  #offerSources(sources, runs) {
    const open = this.hub.status?.source;
    const scenes = sources.filter(
      ({ group, template, board }) => group === "simulated" && !template && !board,
    );
    const first = scenes.filter(({ spec }) => spec === FIRST);
    /** @type {[string, string][]} */
    const choices = [...first, ...scenes.filter((scene) => !first.includes(scene))].map(
      ({ spec, title }) => [spec, title],
    );
    if (open) choices.splice(1, 0, [OPEN, `Current source: ${open.name}`]);
    const recorded = runs.filter((run) => hasImages(run) && !run.tags.includes(COMPARISON_TAG));
    for (const run of recorded) choices.push([`run:${run.id}`, `Recording: ${run.name}`]);
    offer(this.#source, choices, this.#source.value || FIRST);
  }

  async #start() {
    const seconds = this.#seconds.valueAsNumber;
    const source = this.#source.value;
    await this.#do(async () => {
      if (!(seconds >= 1 && seconds <= 30))
        throw new ApiError("Seconds must be a number from 1 to 30.", 0);
      /** @type {ComparisonStatus} */
      const status = await request("POST", "/comparison", {
        seconds,
        ...(source && source !== OPEN ? { source } : {}),
      });
      this.#showStatus(status);
    });
  }

  async #cancelled() {
    await attemptIn(this.#error, async () => {
      this.#showStatus(await request("POST", "/comparison/cancel"));
    });
  }

  async #ask() {
    clearTimeout(this.#timer);
    const asked = this.#asked;
    /** @type {ComparisonStatus | null} */
    const status = await request("GET", "/comparison").catch(() => null);
    if (asked === this.#asked && status) this.#showStatus(status);
  }

  /** @param {ComparisonStatus} status */
  #showStatus({ going, runs, trouble }) {
    clearTimeout(this.#timer);
    const ended = !this.#going.hidden && !going;
    this.#begin.disabled = going !== null;
    if (!going) moveFocus(this.#going, this.#begin);
    this.#going.hidden = !going;
    this.#before.hidden = !going || this.#ids.length < 2;
    if (trouble) setText(this.#error, sentence(trouble));
    if (going) {
      this.#bar.value = going.share;
      if (going.share > 0) void this.#look();
      else this.#picture.removeAttribute("src");
      setText(
        this.#words,
        `Comparing paper (left) with default (right) on ${going.source_name}. ${this.#pace(going)}`,
      );
      if (this.#shown) this.#timer = setTimeout(() => void this.#ask(), ASK_EVERY_MS);
    } else if (ended && runs && !trouble) {
      this.hub.emit("runs");
      location.hash = methodsHref([...runs]);
    }
  }

  /** @param {NonNullable<ComparisonStatus["going"]>} going @returns {string} how far it is, and how long it still takes */
  #pace({ words, share, held }) {
    const now = { at: performance.now(), share };
    // Another comparison, or one that stood still.
    if (held || share === 0 || share < this.#began.share) this.#began = now;
    if (held) return `${sentence(words)} Waiting until no robot is armed.`;
    const left = timeLeft(this.#began, now);
    return left ? sentence(`${words}, ${left}`) : sentence(words).replace(/\.$/, "…");
  }

  /** Show the frame being processed, if there is one. */
  async #look() {
    const image = await requestImage("/comparison/picture.jpg").catch(() => null);
    if (!image?.blob.size || this.#going.hidden) return;
    URL.revokeObjectURL(this.#picture.src);
    this.#picture.src = URL.createObjectURL(image.blob);
  }

  async #load() {
    const asked = this.#asked;
    const ids = this.#ids;
    setText(this.#waiting, "Reading both runs…");
    const paths = ids.map((id) => `/runs/${encodeURIComponent(id)}`);
    const done = await attemptIn(this.#error, async () => {
      /** @type {Promise<Run>[]} */
      const runs = paths.map((path) => request("GET", path));
      /** @type {Promise<RunFrames>[]} */
      const frames = paths.map((path) => request("GET", `${path}/frames`));
      const [answered, found] = await Promise.all([Promise.all(runs), Promise.all(frames)]);
      if (asked !== this.#asked) return;
      if (!sameFrames(found))
        throw new ApiError(
          "These runs have different frames. Compare their speeds instead, or compare the methods on one recording.",
          0,
        );
      const names = methodNames(answered);
      this.#split.show(
        answered.map((run, at) => ({
          run,
          name: names[at] ?? run.name,
          found: /** @type {RunFrames} */ (found[at]),
        })),
        positionOf(location.hash),
      );
      this.#more.replaceChildren(
        h("a", { href: compareHref(ids) }, "Speeds, errors and parameters of both runs"),
      );
    });
    if (asked !== this.#asked) return;
    setText(this.#waiting, "");
    if (!done) this.#failed = true;
  }

  /** @param {Run[][]} pairs */
  #list(pairs) {
    this.#earlierPart.hidden = pairs.length === 0;
    this.#earlier.replaceChildren(
      ...pairs.map((runs) => {
        const [first] = runs;
        const words = `${first?.source_name}, ${methodNames(runs).join(" and ")}`;
        const href = methodsHref(runs.map(({ id }) => id));
        return h("li", h("a", { href }, words), ` · ${when(first?.started_at ?? "")}`);
      }),
    );
  }
}

/**
 * Find the comparisons among runs.
 *
 * @param {Run[]} runs newest first
 * @returns {Run[][]} the two of each
 */
function pairsOf(runs) {
  const made = runs.filter(
    ({ tags, state }) => tags.includes(COMPARISON_TAG) && state === "finished",
  );
  return made.flatMap((second) => {
    const first = made.find(({ id }) => id === second.rerun_of);
    return first ? [[first, second]] : [];
  });
}

customElements.define("observer-methods", MethodsView);
