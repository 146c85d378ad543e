/** State of the server: rates, latency, time of each stage, dropped frames and why. */

import { fillList, h, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { fixed } from "../elements/words.js";

/** @import { Status } from "../contract" */

class StatusPanel extends Part {
  /** @type {Map<string, HTMLElement>} */
  #figures = new Map();
  #bars = h("ul.bars", { "aria-label": "Time of each stage" });
  #total = h("span.figure");
  #skipped = h("ul.plain-list");
  #warnings = h("ul.plain-list.warnings", { "aria-label": "Warnings" });
  #noneSkipped = h("p.hint", "No frame was skipped.");

  build() {
    this.append(
      h("h2", "Status"),
      h(
        "dl.figures",
        this.#figure("rate", "Unique frames", "frames observed each second, each counted once"),
        this.#figure(
          "dense",
          "Dense cloud",
          "clouds and disparity views made each second, and the newest one's age",
        ),
        this.#figure("median", "Exposure to page", "median from reception to painted here"),
        this.#figure("p95", "Exposure to page, 95 %", "19 of 20 frames are faster"),
        this.#figure("viewers", "Open pages", "that receive live data now"),
        this.#figure("restarts", "Engine restarts", "since the server was started"),
        this.#figure("frames_skipped", "Frames skipped", "that the source could not read"),
        this.#figure("observations_lost", "Observations lost", "between engine and server"),
        this.#figure(
          "live_messages_dropped",
          "Messages left out",
          "for pages slower than the frames",
        ),
        this.#figure("writes_dropped", "Not kept", "because the database was not to be had"),
      ),
      this.#warnings,
      h("h3", "Stage timings ", this.#total),
      this.#bars,
      h("h3", "Skipped frames"),
      this.#noneSkipped,
      this.#skipped,
      h("p.hint", this.#value("version"), " · ", h("a", { href: "/docs" }, "REST interface")),
    );
    this.hear("status", () => this.#render());
    this.whenShown(() => this.#render());
    this.#render();
  }

  /**
   * @param {string} key
   * @param {string} term
   * @param {string} help
   */
  #figure(key, term, help) {
    return h("div", { title: help }, h("dt", term), h("dd.figure", this.#value(key)));
  }

  /** @param {string} key */
  #value(key) {
    const node = h("span", "–");
    this.#figures.set(key, node);
    return node;
  }

  #render() {
    const { status } = this.hub;
    if (!status || this.offsetParent === null) return;
    for (const [key, text] of Object.entries(figuresOf(status))) {
      const node = this.#figures.get(key);
      if (node) setText(node, text);
    }
    this.#renderBars(status.timings_ms);
    this.#noneSkipped.hidden = status.skipped.length > 0;
    fillList(
      this.#skipped,
      status.skipped.map(({ index, reason }) => `Frame ${index}: ${reason}`),
    );
    fillList(this.#warnings, status.warnings);
  }

  /** @param {Record<string, number>} timings stage -> median ms; a "total" is no stage */
  #renderBars(timings) {
    const stages = Object.entries(timings).filter(([name]) => name !== "total");
    const sum = stages.reduce((total, [, ms]) => total + ms, 0);
    const total = timings.total ?? sum;
    setText(this.#total, stages.length ? `${fixed(total, 1)} ms together` : "");
    const longest = Math.max(1, ...stages.map(([, ms]) => ms));
    if (this.#bars.childElementCount !== stages.length) {
      this.#bars.replaceChildren(
        ...stages.map(() =>
          h("li", h("span"), h("meter", { min: 0, max: 1, value: 0 }), h("span.figure")),
        ),
      );
    }
    stages.forEach(([name, ms], index) => {
      const [label, meter, value] = this.#bars.children[index]?.children ?? [];
      if (!label || !(meter instanceof HTMLMeterElement) || !value) return;
      const words = name.replaceAll("_", " ");
      setText(label, words);
      meter.value = ms / longest;
      meter.setAttribute("aria-label", `${words}: ${fixed(ms, 1)} ms`);
      setText(value, `${fixed(ms, 1)} ms`);
    });
  }
}

/** @param {Status} status @returns {Record<string, string>} */
function figuresOf({ rates, dense_stereo, latency_ms, viewers, engine, drops, version }) {
  return {
    rate: `${fixed(rates.unique_frames_per_s, 1)} /s`,
    dense: denseWords(dense_stereo),
    median: `${fixed(latency_ms.median, 0)} ms`,
    p95: `${fixed(latency_ms.p95, 0)} ms`,
    viewers: String(viewers),
    restarts: String(engine.restarts),
    frames_skipped: String(drops.frames_skipped),
    observations_lost: String(drops.observations_lost),
    live_messages_dropped: String(drops.live_messages_dropped),
    writes_dropped: String(drops.writes_dropped),
    version: `Dynamic Observer ${version}${engine.pid ? `, engine process ${engine.pid}` : ""}`,
  };
}

/** @param {Status["dense_stereo"]} dense */
function denseWords({ per_s, age_s, coarseness }) {
  if (!per_s || age_s === null) return "–";
  const grid = coarseness && coarseness > 1 ? `, of 1/${coarseness} size` : "";
  return `${fixed(per_s, 1)} /s, ${fixed(1000 * age_s, 0)} ms old${grid}`;
}

customElements.define("observer-status", StatusPanel);
