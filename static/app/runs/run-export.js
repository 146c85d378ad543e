/** All exports of a run behind one button, and the state of the current one. */

import { chartGroups } from "../chart/chart-files.js";
import { button, download, field, h, select, setText } from "../elements/dom.js";
import { ExportMenu } from "../elements/export-menu.js";
import { moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { Aborted, ApiError, requestImage } from "../shell/api.js";
import { showModal } from "../shell/modal.js";
import { hasImages, size } from "./run-words.js";

/** @import { Run } from "../contract" */
/** @import { Offer } from "../chart/chart-files.js" */
/** @import { MenuGroup, MenuItem } from "../elements/export-menu.js" */

/** @typedef {{words: string, ending: string, path: string, help: string, images?: boolean}} Made */

/** @type {Made[]} */
const MADE = [
  {
    words: "Report, HTML",
    ending: "html",
    path: "report",
    help: "Figures, errors, parameters and calibration on one page",
  },
  {
    words: "Video, MP4",
    ending: "mp4",
    path: "export?format=mp4",
    help: "Left image with tracks drawn on it",
    images: true,
  },
  {
    words: "Everything, ZIP",
    ending: "zip",
    path: "export?format=zip",
    help: "Tables, JSON lines, camera trajectory (TUM), video and point cloud with a README",
  },
  {
    words: "Point cloud, PLY",
    ending: "ply",
    path: "export?format=ply",
    help: "Of the first recorded frame",
    images: true,
  },
  {
    words: "ROS 2 bag, ZIP",
    ending: "ros2.zip",
    path: "export?format=ros2",
    help: "For ros2 bag play",
  },
];

/** @type {[string, string][]} */
const TABLES = [
  ["obstacles", "every obstacle in every frame"],
  ["frames", "frames and camera motion"],
  ["truth", "ground truth"],
  ["matched_truth", "ground truth with matched estimates"],
  ["odometry", "robot odometry"],
  ["robots", "robot commands and telemetry"],
  ["goal", "goal, planned path and reasons"],
  ["map", "local maps on the way to a goal"],
  ["parameters", "parameters and changes"],
];

/** @type {[string, string][]} */
const TABLE_FORMATS = [
  ["csv", "CSV"],
  ["parquet", "Parquet, for pandas and Polars"],
];

export class RunExport extends Part {
  #menu = new ExportMenu(() => this.#groups());
  #state = h("span", { role: "status" });
  #cancel = button("Cancel", () => this.#making?.abort());
  #error = h("span.field-error", { role: "alert" });
  /** State and outcome of an export; placed by the caller where there is room. */
  message = h("p.export-message", { hidden: true }, this.#state, this.#cancel, this.#error);
  /** @type {Run | null} */
  #run = null;
  /** @type {() => Offer[]} */
  #chart;
  /** Cancels the file being made. @type {AbortController | null} */
  #making = null;

  /** @param {() => Offer[]} chart files of the visible part of the run's chart */
  constructor(chart = () => []) {
    super();
    this.#chart = chart;
  }

  build() {
    this.append(this.#menu);
  }

  /** @param {Run} run */
  show(run) {
    if (run.id !== this.#run?.id) {
      this.#making?.abort();
      this.#report("");
    }
    this.#run = run;
  }

  /** @returns {MenuGroup[]} */
  #groups() {
    const run = this.#run;
    if (!run) return [];
    const path = `/api/runs/${encodeURIComponent(run.id)}`;
    const saved = (/** @type {string} */ href, /** @type {string} */ ending) => () =>
      h("a", { href, download: fileName(run, ending) }).click();
    const speeds = {
      words: "Speeds, CSV",
      help: "Estimates, ground truth, commands and wheel encoders",
      take: saved(`${path}/speeds?format=csv`, "csv"),
    };
    const chart = chartGroups(this.#chart(), (words, make) => this.#make(words, make));
    // While the run is being written, or if it was not recorded, only its speeds are available.
    if (run.record === null || run.state === "running")
      return [{ title: "Run", items: [speeds] }, ...chart];
    /** @type {MenuItem[]} */
    const items = MADE.filter(({ images }) => !images || hasImages(run)).map((made) => ({
      ...made,
      take: () => this.#exportFile(run, made.path, made.ending, made.words),
    }));
    items.splice(
      1,
      0,
      {
        words: "Report in a new tab",
        help: "Takes up to a minute to open",
        take: () => window.open(`${path}/report`, "_blank", "noopener"),
      },
      {
        words: "Recording, MCAP",
        help: `${size(run.recording_bytes)}; for Foxglove, Lichtblick and as a source`,
        take: saved(`${path}/recording`, "mcap"),
      },
      {
        words: "Table, CSV or Parquet…",
        help: "Tracks, ground truth, odometry and more",
        take: () => this.#ask(run),
      },
      speeds,
    );
    return [{ title: "Run", items }, ...chart];
  }

  /** Ask which table. @param {Run} run */
  async #ask(run) {
    const table = select({ id: "export-table" }, TABLES);
    const format = select({ id: "export-format" }, TABLE_FORMATS);
    const answer = await showModal(
      "question",
      "Export table",
      [field("Table", table), field("Format", format)],
      h("button.button", { value: "no" }, "Cancel"),
      h("button.button.primary", { value: "yes" }, "Export"),
    );
    this.#menu.focus();
    if (answer !== "yes") return;
    const path = `export?format=${format.value}&table=${table.value}`;
    await this.#exportFile(run, path, format.value, `Table ${table.value}`, ` ${table.value}`);
  }

  /**
   * @param {Run} run
   * @param {string} path below the run's path
   * @param {string} ending of the file
   * @param {string} words
   * @param {string} part added to the file's name
   */
  #exportFile(run, path, ending, words, part = "") {
    return this.#make(words, async (signal) => {
      const { blob } = await requestImage(`/runs/${encodeURIComponent(run.id)}/${path}`, signal);
      return { blob, name: fileName(run, ending, part) };
    });
  }

  /**
   * Make one file at a time: each keeps a core of the server busy.
   *
   * @param {string} words
   * @param {(signal: AbortSignal) => Promise<{blob: Blob, name: string}>} make
   */
  async #make(words, make) {
    const run = this.#run;
    if (this.#making) {
      this.message.hidden = false;
      return setText(this.#error, "Another export is in progress. Wait for it or cancel it.");
    }
    const making = new AbortController();
    this.#making = making;
    this.#report(`Exporting ${words}…`, true);
    let end = "";
    let refused = "";
    try {
      const { blob, name } = await make(making.signal);
      if (!making.signal.aborted) {
        download(blob, name);
        end = `${words} exported: ${size(blob.size)}.`;
      }
    } catch (error) {
      if (error instanceof ApiError) refused = error.message;
      else if (!(error instanceof Aborted)) throw error;
    } finally {
      this.#making = null;
      if (making.signal.aborted) end = `${words} cancelled.`;
      moveFocus(this.#cancel, this.#menu);
      if (run === this.#run || run?.id === this.#run?.id) this.#report(end, false, refused);
    }
  }

  /** @param {string} words @param {boolean} [going] @param {string} [refused] */
  #report(words, going = false, refused = "") {
    setText(this.#state, words);
    setText(this.#error, refused);
    this.#cancel.hidden = !going;
    this.message.hidden = words === "" && refused === "";
  }
}

/** @param {Run} run @param {string} ending @param {string} [part] */
function fileName({ name }, ending, part = "") {
  return `${name}${part}.${ending}`.replace(/[\\/:]/g, "_");
}

customElements.define("observer-run-export", RunExport);
