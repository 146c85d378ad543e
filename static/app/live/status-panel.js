/** State of the server: rates, latency, time of each stage, dropped frames and why. */

import { fillList, h, setAttribute, setText } from "../elements/dom.js";
import { fillFigures } from "../elements/figure-list.js";
import { Part } from "../elements/part.js";
import { GLOSSARY } from "../elements/glossary.js";
import { age, fixed } from "../elements/words.js";
import { groupTitle } from "../parameters/value-words.js";

/** @import { Status } from "../contract" */
/** @import { Figure } from "../elements/figure-list.js" */

/** Names of stages where the key alone says too little, and what each does. @type {Record<string, [string, string]>} */
const STAGES = {
  rectification: ["Rectification", "brings matching points onto the same row of both images"],
  features: ["Features", "finds points to follow"],
  klt_tracking: ["KLT tracking", "follows the points from frame to frame"],
  matching: ["Matching", "finds the points of one frame in the next"],
  stereo: ["Stereo", "measures the depth of the points"],
  ego_motion: ["Ego-motion", GLOSSARY["ego-motion"]],
  image_transformation: ["Image transformation", "removes the camera's own motion from the image"],
  residual_flow: ["Residual flow", GLOSSARY["residual"]],
  motion: ["Motion test", "tells moving points from static ones"],
  dense: ["Dense stereo", "measures depth in the whole image"],
  clustering: ["Clustering", "groups moving points into obstacles"],
  tracking: ["Obstacle tracking", "follows every obstacle from frame to frame"],
  drift: ["Stereo drift", "learns how the calibration drifts"],
  unseen: ["Blind areas", "finds where motion would go unnoticed"],
  health: ["Image health", "looks for covered, dark or blurred lenses"],
};

class StatusPanel extends Part {
  #figures = h("dl.figures");
  #version = h("span", "–");
  #bars = h("ul.bars", { "aria-label": "Stage timings" });
  #total = h("span.figure");
  #skipped = h("ul.plain-list");
  #warnings = h("ul.plain-list.warnings", { "aria-label": "Warnings" });
  #noneSkipped = h("p.hint", "No frames skipped.");

  build() {
    this.append(
      h("h2", "Status"),
      this.#figures,
      this.#warnings,
      h("h3", "Stage timings ", this.#total),
      h("p.hint", "Processing time of each stage per frame, median."),
      this.#bars,
      h("h3", "Skipped frames"),
      this.#noneSkipped,
      this.#skipped,
      h("p.hint", this.#version, " · ", h("a", { href: "/docs" }, "REST API")),
    );
    this.listen("status", () => this.#render());
    this.whenShown(() => this.#render());
    this.#render();
  }

  #render() {
    const { status } = this.hub;
    if (!status || this.offsetParent === null) return;
    fillFigures(this.#figures, figuresOf(status));
    const { version, engine } = status;
    setText(
      this.#version,
      `Dynamic Observer ${version}${engine.pid ? `, engine process ${engine.pid}` : ""}`,
    );
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
    setText(this.#total, stages.length ? `${fixed(total, 1)} ms total` : "");
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
      const [words, help] = STAGES[name] ?? [groupTitle(name), null];
      setText(label, words);
      setAttribute(label, "title", help);
      meter.value = ms / longest;
      meter.setAttribute("aria-label", `${words}: ${fixed(ms, 1)} ms`);
      setText(value, `${fixed(ms, 1)} ms`);
    });
  }
}

/** @param {Status} status @returns {Figure[]} */
function figuresOf({ rates, dense_stereo, latency_ms, viewers, engine, drops }) {
  return [
    [
      "Unique frames",
      `${fixed(rates.unique_frames_per_s, 1)} /s`,
      "frames processed per second, each counted once",
    ],
    [
      "Dense cloud",
      denseCloudInWords(dense_stereo),
      "point clouds and disparity images per second, and the age of the newest",
    ],
    [
      "Latency to page, median",
      `${fixed(latency_ms.median, 0)} ms`,
      "from receiving a frame to drawing it on this page",
    ],
    [
      "Latency to page, 95th percentile",
      `${fixed(latency_ms.p95, 0)} ms`,
      "19 of 20 frames are faster",
    ],
    ["Open pages", String(viewers), "pages that receive live data now"],
    ["Engine restarts", String(engine.restarts), "since the server started"],
    ["Frames skipped", String(drops.frames_skipped), "frames that the source could not read"],
    ["Observations dropped", String(drops.observations_lost), "because the server was busy"],
    [
      "Messages dropped",
      String(drops.live_messages_dropped),
      "because a page was slower than the frame rate",
    ],
    ["Writes dropped", String(drops.writes_dropped), "while the database was unavailable"],
  ];
}

/** @param {Status["dense_stereo"]} dense */
function denseCloudInWords({ per_s, age_s, coarseness }) {
  if (!per_s || age_s === null) return "–";
  const grid = coarseness && coarseness > 1 ? `, at 1/${coarseness} size` : "";
  return `${fixed(per_s, 1)} /s, ${age(age_s)} old${grid}`;
}

customElements.define("observer-status", StatusPanel);
