/** Motion-capture files: upload one, see how it was read, choose one. */

import {
  button,
  details,
  dropZone,
  field,
  h,
  iconButton,
  input,
  offer,
  setText,
  table,
  tableRow,
} from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { counted, fixed, sentence, when } from "../elements/words.js";
import { ApiError, request } from "../shell/api.js";
import { attempt, askConfirmation, exclusiveRunner } from "../shell/notice.js";

/** @import { TruthEntry as TruthFile } from "../contract" */

// Not the id of a file.
const LIVE = "live";

export class TruthPicker extends Part {
  /** Called when the choice changes; null: no file. @type {(file: TruthFile | null) => void} */
  chosen = () => {};

  #file = input("file", "truth-file", {
    accept: ".csv,.c3d,.txt,.tum,.tsv",
    "aria-describedby": "truth-file-help truth-error",
  });
  #rate = input("number", "truth-rate", {
    min: 1,
    max: 10000,
    step: "any",
    placeholder: "from the file",
  });
  #select = h("select", { id: "truth-select" });
  #remove = iconButton("trash", "Delete ground-truth file", () => this.#delete());
  #choice = h("div.field");
  #sending = h("p.hint", { role: "status" });
  #error = h("p.field-error", { id: "truth-error", role: "alert" });
  #angles = h("div.row", {
    role: "group",
    "aria-label": "Angle convention",
    hidden: true,
  });
  #reading = h("div.stack.file-summary");
  /** @type {TruthFile[]} */
  #all = [];
  /** The file whose angle convention was ambiguous. @type {File | null} */
  #unclear = null;
  #do = exclusiveRunner(undefined, this.#error);

  build() {
    this.#choice.append(
      h("label", { for: "truth-select" }, "Ground truth"),
      h("div.row", this.#select, this.#remove),
    );
    const helical = button("Helical (Vicon Tracker)", () => this.#send(this.#unclear, "helical"));
    const euler = button("Euler angles XYZ", () => this.#send(this.#unclear, "euler_xyz"));
    this.#angles.append(helical, euler);
    const drop = dropZone(
      this.#file,
      "Choose a motion-capture file, or drop it here",
      "Vicon Tracker, Nexus, OptiTrack Motive, C3D, EuRoC, TUM, or plain CSV with t,x,y,z in seconds and metres; the format is detected automatically.",
      ([file]) => this.#send(file ?? null),
      details("Sample rate, if the file has none", field("Sample rate, Hz", this.#rate)),
      this.#error,
      this.#angles,
      this.#sending,
    );
    this.append(this.#choice, this.#reading, drop);
    this.#select.addEventListener("change", () => this.#render());
  }

  /** @returns {TruthFile | null} */
  get file() {
    return this.find(this.#select.value);
  }

  /** True if the motion capture in the run's own recording is chosen. */
  get live() {
    return this.#select.value === LIVE;
  }

  /** @param {string | null} id @returns {TruthFile | null} */
  find(id) {
    return this.#all.find((file) => file.id === id) ?? null;
  }

  /** Load the files, and choose this one if it exists. @param {string | null} id */
  async load(id) {
    /** @type {TruthFile[] | null} */
    const all = await request("GET", "/truth").catch(() => null);
    if (!all) return;
    this.#all = all;
    offer(
      this.#select,
      [
        ["", "Choose a file, or upload one below"],
        [LIVE, "Motion capture received during the run"],
        ...all.map((file) => [file.id, `${file.name} (${when(file.created_at)})`]),
      ],
      id,
    );
    this.#render();
  }

  #render() {
    const { file } = this;
    this.#remove.hidden = file === null;
    this.#reading.replaceChildren(...(file ? readingOf(file) : []));
    this.chosen(file);
  }

  /**
   * @param {File | null} file
   * @param {"helical" | "euler_xyz"} [angles] the convention chosen by the user
   */
  async #send(file, angles) {
    if (!file) return;
    const form = new FormData();
    form.append("file", file);
    if (this.#rate.value) form.append("rate_hz", this.#rate.value);
    if (angles) form.append("angles", angles);
    const send = async () => {
      this.#unclear = null;
      this.#angles.hidden = true;
      try {
        /** @type {TruthFile} */
        const taken = await request("POST", "/truth", form);
        await this.load(taken.id);
      } catch (error) {
        // The one thing that only the user can tell.
        if (error instanceof ApiError && "angles" in error.fields) this.#unclear = file;
        this.#angles.hidden = this.#unclear === null;
        throw error;
      }
    };
    await this.#do(send, this.#sending, `Reading ${file.name}…`);
    const why = this.#error.textContent;
    if (why) setText(this.#error, withFileName(why, file.name));
  }

  async #delete() {
    const { file } = this;
    if (
      !file ||
      !(await askConfirmation(
        `Delete ground-truth file ${file.name}?`,
        "You cannot undo this. Runs that were aligned with it keep their results.",
        "Delete file",
      ))
    )
      return;
    await attempt(() => request("DELETE", `/truth/${encodeURIComponent(file.id)}`));
    this.#select.focus();
    await this.load(null);
  }
}

/**
 * @param {string} message a sentence, which may begin with the file's name
 * @param {string} name
 */
function withFileName(message, name) {
  const named = message.toLowerCase().startsWith(name.toLowerCase());
  return named ? `${name}${message.slice(name.length)}` : `${name} not imported: ${message}`;
}

/**
 * Show how the file was read, so that the user can check it.
 *
 * @param {TruthFile} file
 */
function readingOf({ format, info }) {
  const { bodies, notes, rate_hz: rate, duration_s: seconds } = info;
  const facts = [
    format,
    rate === null ? null : `${Number(rate.toFixed(2))} Hz`,
    seconds === null ? null : `${fixed(seconds, 1)} s`,
    // Ground truth of the simulator has no bodies to choose from.
    bodies.length > 0 && counted(bodies.length, "body").replace("bodys", "bodies"),
  ];
  return [
    h("p", "Read as ", h("b", facts.filter(Boolean).join(", ")), "."),
    ...(bodies.length > 0 ? [tableOf(bodies)] : []),
    ...(notes.length > 0
      ? [h("ul.plain-list", ...notes.map((note) => h("li", sentence(note))))]
      : []),
  ];
}

/** @param {TruthFile["info"]["bodies"]} bodies */
function tableOf(bodies) {
  return table(
    "",
    ["Body", "Orientation", "Samples", "Gaps", "Extent, m", "Max speed, m/s"],
    bodies.map((body) =>
      tableRow(
        body.name,
        body.has_orientation ? "known" : "unknown",
        body.samples === body.seen ? body.samples : `${body.seen} of ${body.samples}`,
        body.gaps,
        body.extent_m ? body.extent_m.map((metres) => fixed(metres, 2)).join(" × ") : "–",
        fixed(body.highest_speed_mps, 2),
      ),
    ),
    undefined,
    { role: "region", "aria-label": "File contents", tabindex: "0" },
  );
}

customElements.define("observer-truth-picker", TruthPicker);
