/** Files of motion capture: send one in, see what was understood of it, choose one. */

import {
  button,
  details,
  field,
  h,
  icon,
  iconButton,
  onDrop,
  setText,
  table,
  tableRow,
} from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { counted, fixed, sentence, when } from "../elements/words.js";
import { ApiError, request } from "../shell/api.js";
import { attempt, confirmed } from "../shell/notice.js";

/** @import { TruthEntry } from "../contract" */
/**
 * @typedef {object} TruthBody what was understood of one body of a truth file
 * @property {string} name
 * @property {boolean} has_orientation
 * @property {number} samples
 * @property {number} seen
 * @property {number} gaps
 * @property {number[] | null} extent_m along the room's axes
 * @property {number | null} highest_speed_mps
 */
/**
 * @typedef {TruthEntry & {info: {rate_hz: number | null, duration_s: number | null,
 *   bodies: TruthBody[], notes: string[]}}} TruthFile
 */

// No file's id.
const LIVE = "live";

export class TruthPicker extends Part {
  /** Called when something else is chosen; null: no file. @type {(file: TruthFile | null) => void} */
  chosen = () => {};

  #file = h("input", {
    type: "file",
    id: "truth-file",
    accept: ".csv,.c3d,.txt,.tum,.tsv",
    "aria-describedby": "truth-help truth-error",
  });
  #rate = h("input", {
    type: "number",
    id: "truth-rate",
    min: 1,
    max: 10000,
    step: "any",
    placeholder: "as the file says",
  });
  #drop = h("div.drop");
  #select = h("select", { id: "truth-select" });
  #remove = iconButton("trash", "Delete this truth file", () => this.#delete());
  #choice = h("div.field");
  #sending = h("p.hint", { role: "status" });
  #error = h("p.field-error", { id: "truth-error", role: "alert" });
  #angles = h("div.row", {
    role: "group",
    "aria-label": "How the angles are meant",
    hidden: true,
  });
  #understood = h("div.stack.understood");
  /** @type {TruthFile[]} */
  #all = [];
  /** The file whose angles were not clear. @type {File | null} */
  #unclear = null;
  #busy = false;

  build() {
    this.#choice.append(
      h("label", { for: "truth-select" }, "Truth"),
      h("div.row", this.#select, this.#remove),
    );
    const helical = button("Helical, as Tracker writes them", () =>
      this.#send(this.#unclear, "helical"),
    );
    const euler = button("Euler angles XYZ", () => this.#send(this.#unclear, "euler_xyz"));
    this.#angles.append(helical, euler);
    this.#drop.append(
      h(
        "label",
        { for: "truth-file" },
        icon("upload"),
        "Choose a file of motion capture, or drop it here",
      ),
      this.#file,
      h(
        "p.hint",
        { id: "truth-help" },
        "Vicon Tracker or Nexus CSV, C3D, CSV with t,x,y,z in seconds and metres, or TUM; recognised by content.",
      ),
      details("Where the file tells no rate", field("Rate, Hz", this.#rate)),
      this.#error,
      this.#angles,
      this.#sending,
    );
    this.append(this.#choice, this.#understood, this.#drop);
    this.#file.addEventListener("change", () => void this.#send(this.#file.files?.[0] ?? null));
    this.#select.addEventListener("change", () => this.#tell());
    onDrop(this.#drop, ([file]) => this.#send(file ?? null));
  }

  /** @returns {TruthFile | null} */
  get file() {
    return this.find(this.#select.value);
  }

  /** True where the motion capture in the run's own recording is chosen. */
  get live() {
    return this.#select.value === LIVE;
  }

  /** @param {string | null} id @returns {TruthFile | null} */
  find(id) {
    return this.#all.find((file) => file.id === id) ?? null;
  }

  /** Read what there is, and choose this one where it is there. @param {string | null} id */
  async load(id) {
    await this.#load(id ?? "");
  }

  /** @param {string | null} id */
  #choose(id) {
    this.#select.value = id === LIVE || this.find(id) ? (id ?? "") : "";
    this.#tell();
  }

  async #load(chosen = this.#select.value) {
    /** @type {TruthFile[] | null} */
    const all = await request("GET", "/truth").catch(() => null);
    if (!all) return;
    this.#all = all;
    this.#select.replaceChildren(
      h("option", { value: "" }, "Choose one, or send one in below"),
      h("option", { value: LIVE }, "What was received live with the run"),
      ...all.map((file) =>
        h("option", { value: file.id }, `${file.name} (${when(file.created_at)})`),
      ),
    );
    this.#choose(chosen);
  }

  #tell() {
    const { file } = this;
    this.#remove.hidden = file === null;
    this.#understood.replaceChildren(...(file ? understood(file) : []));
    this.chosen(file);
  }

  /**
   * @param {File | null} file
   * @param {"helical" | "euler_xyz"} [angles] what a person said of them
   */
  async #send(file, angles) {
    if (!file || this.#busy) return;
    this.#busy = true;
    this.#unclear = null;
    this.#angles.hidden = true;
    setText(this.#error, "");
    setText(this.#sending, `Reading ${file.name}…`);
    const form = new FormData();
    form.append("file", file);
    if (this.#rate.value) form.append("rate_hz", this.#rate.value);
    if (angles) form.append("angles", angles);
    try {
      /** @type {TruthFile} */
      const taken = await request("POST", "/truth", form);
      await this.#load(taken.id);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      // The one thing that only a person can tell.
      this.#unclear = "angles" in error.fields ? file : null;
      this.#angles.hidden = this.#unclear === null;
      setText(this.#error, naming(error.message, file.name));
    } finally {
      this.#busy = false;
      setText(this.#sending, "");
      // The same file, corrected, can be chosen again.
      this.#file.value = "";
    }
  }

  async #delete() {
    const { file } = this;
    if (
      !file ||
      !(await confirmed(
        `Delete ${file.name}?`,
        "Runs that were aligned with it keep their results.",
        "Delete file",
      ))
    )
      return;
    await attempt(() => request("DELETE", `/truth/${encodeURIComponent(file.id)}`));
    this.#select.focus();
    await this.#load("");
  }
}

/**
 * @param {string} message a sentence, which may begin with the file's name
 * @param {string} name
 */
function naming(message, name) {
  const named = message.toLowerCase().startsWith(name.toLowerCase());
  return named ? `${name}${message.slice(name.length)}` : `${name} was not taken: ${message}`;
}

/**
 * Show how the file was understood, for a person to see whether that is right.
 *
 * @param {TruthFile} file
 */
function understood({ format, info }) {
  const { bodies, notes, rate_hz: rate, duration_s: seconds } = info;
  const facts = [
    format,
    rate === null ? null : `${Number(rate.toFixed(2))} Hz`,
    seconds === null ? null : `${fixed(seconds, 1)} s`,
    counted(bodies.length, "body").replace("bodys", "bodies"),
  ];
  return [
    h("p", "Understood as ", h("b", facts.filter(Boolean).join(", ")), "."),
    h(
      "div.scroll-x",
      { role: "region", "aria-label": "What the file holds", tabindex: "0" },
      table(
        "",
        ["Body", "Turns", "Samples", "Gaps", "Reaches over, m", "Fastest, m/s"],
        bodies.map((body) =>
          tableRow(
            body.name,
            body.has_orientation ? "known" : "not known",
            body.samples === body.seen ? body.samples : `${body.seen} of ${body.samples}`,
            body.gaps,
            body.extent_m ? body.extent_m.map((metres) => fixed(metres, 2)).join(" × ") : "–",
            fixed(body.highest_speed_mps, 2),
          ),
        ),
      ),
    ),
    ...(notes.length > 0
      ? [h("ul.plain-list", ...notes.map((note) => h("li", sentence(note))))]
      : []),
  ];
}

customElements.define("observer-truth-picker", TruthPicker);
