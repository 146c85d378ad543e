/** A run as files: the report, and what other tools read. */

import {
  button,
  download,
  downloadLink,
  field,
  h,
  icon,
  select,
  setAttribute,
  setText,
} from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { ApiError, requestImage } from "../shell/api.js";
import { size } from "./run-words.js";

/** @import { Run } from "../contract" */

/** Path below the run's, ending of the file, words, help. @type {[string, string, string, string][]} */
const FILES = [
  [
    "report",
    "html",
    "Report",
    "One page with the paper's figures for this run, its errors, parameters and calibration.",
  ],
  [
    "export?format=zip",
    "zip",
    "Everything, ZIP",
    "Tables, video and point cloud, with a README that explains the columns.",
  ],
  ["export?format=csv", "csv", "Table, CSV", "The table selected below."],
  ["export?format=parquet", "parquet", "Table, Parquet", "The same table for pandas and Polars."],
  ["export?format=mp4", "mp4", "Video, MP4", "The left image with tracks drawn on it."],
  ["export?format=ply", "ply", "Point cloud, PLY", "The first recorded frame."],
  ["export?format=ros2", "ros2.zip", "ROS 2 bag, ZIP", "For ros2 bag play."],
];

/** @type {[string, string][]} */
const TABLES = [
  ["obstacles", "every obstacle in every frame"],
  ["frames", "frames and camera motion"],
  ["truth", "ground truth"],
  ["matched_truth", "ground truth with matched estimates"],
  ["odometry", "robot odometry"],
  ["robots", "robot commands and telemetry"],
  ["parameters", "parameters and changes"],
];

export class RunFiles extends Part {
  #list = h("ul.file-list");
  #table = select({ id: "file-table" }, TABLES);
  #open = h("a", { target: "_blank", rel: "noopener" }, "Open the report in a new tab");
  #state = h("p", { role: "status" });
  #cancel = button("Cancel", () => this.#making?.abort(), { hidden: true });
  #error = h("p.field-error", { role: "alert" });
  #without = h("p.hint");
  #recording = downloadLink("Recording, MCAP", {});
  #speeds = downloadLink("Speeds, CSV", {});
  #more = h("div.stack");
  /** @type {Run | null} */
  #run = null;
  /** The file that is being made. @type {AbortController | null} */
  #making = null;

  build() {
    for (const [path, ending, words, help] of FILES) {
      const make = button([icon("download"), words], () => this.#make(path, ending, words), {
        "aria-describedby": `file-${ending}`,
      });
      this.#list.append(h("li", make, h("span.hint", { id: `file-${ending}` }, help)));
    }
    this.#more.append(
      field("Table for CSV and Parquet", this.#table),
      h("p", this.#open, h("span.hint", " (can take up to a minute)")),
    );
    this.append(
      h("h3", "Report and export"),
      this.#without,
      this.#list,
      this.#more,
      h("div.row", this.#speeds, this.#recording),
      this.#error,
      h("div.row", this.#state, this.#cancel),
    );
  }

  /** @param {Run} run */
  show(run) {
    if (run.id !== this.#run?.id) {
      this.#making?.abort();
      setText(this.#error, "");
      setText(this.#state, "");
    }
    this.#run = run;
    const path = `/api/runs/${encodeURIComponent(run.id)}`;
    const recorded = run.record !== null && run.state !== "running";
    this.#list.hidden = this.#more.hidden = !recorded;
    setAttribute(this.#open, "href", `${path}/report`);
    this.#without.hidden = recorded;
    setText(
      this.#without,
      run.state === "running"
        ? "Available when the run has ended."
        : "This run has no recording to export.",
    );
    this.#recording.hidden = !recorded;
    setAttribute(this.#recording, "href", `${path}/recording`);
    setAttribute(
      this.#recording,
      "title",
      `${run.recording_bytes === null ? "" : `${size(run.recording_bytes)}; `}opens in Foxglove and Lichtblick, or as a source`,
    );
    setAttribute(this.#speeds, "href", `${path}/speeds?format=csv`);
  }

  /**
   * One at a time: each keeps a core of the server busy.
   *
   * @param {string} path
   * @param {string} ending
   * @param {string} words
   */
  async #make(path, ending, words) {
    const run = this.#run;
    if (!run) return;
    if (this.#making)
      return setText(this.#error, "Another export is in progress. Wait for it or cancel it.");
    const table = ["csv", "parquet"].includes(ending) ? this.#table.value : "";
    const making = new AbortController();
    this.#making = making;
    this.#cancel.hidden = false;
    setText(this.#error, "");
    setText(this.#state, `Exporting ${words}…`);
    let end = "";
    try {
      const { blob } = await requestImage(
        `/runs/${encodeURIComponent(run.id)}/${path}${table ? `&table=${table}` : ""}`,
        making.signal,
      );
      const name = `${run.name}${table ? ` ${table}` : ""}.${ending}`;
      download(blob, name.replace(/[\\/:]/g, "_"));
      end = `${words} exported: ${size(blob.size)}.`;
    } catch (error) {
      if (making.signal.aborted) end = `${words} cancelled.`;
      else if (error instanceof ApiError) setText(this.#error, error.message);
      else throw error;
    } finally {
      this.#making = null;
      if (document.activeElement === this.#cancel) this.querySelector("button")?.focus();
      this.#cancel.hidden = true;
      if (run.id === this.#run?.id) setText(this.#state, end);
    }
  }
}

customElements.define("observer-run-files", RunFiles);
