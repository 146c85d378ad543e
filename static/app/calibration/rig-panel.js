/** Camera extrinsics on the robot: typed in, or estimated from the ground or while driving. */

import { button, field, h, input, onSubmit, setAttribute, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { fixed, half95, sentence } from "../elements/words.js";
import { ApiError, request } from "../shell/api.js";
import { notify, exclusiveRunner } from "../shell/notice.js";

/** @import { DriveNow, FloorEstimate, RigNow, RigNumber } from "../contract" */

/** Key, words, unit, digits, help. @type {[string, string, string, number, string][]} */
const NUMBERS = [
  ["height_m", "Height", "m", 3, "of the left lens above the floor"],
  ["tilt_deg", "Tilt", "°", 2, "positive when the camera looks down"],
  ["roll_deg", "Roll", "°", 2, "positive when the right side is lower"],
  ["pan_deg", "Pan", "°", 2, "positive to the left of the driving direction"],
  ["forward_m", "Forward", "m", 3, "from the middle of the axle"],
  ["left_m", "Left", "m", 3, "from the middle of the axle"],
];

const SIMULATED = "simulated:";
const DRIVE_ASKED_MS = 2000;

export class RigPanel extends Part {
  #inputs = new Map(
    NUMBERS.map(([key]) => [
      key,
      input("text", `rig-${key}`, {
        inputmode: "decimal",
        placeholder: "unknown",
        "aria-describedby": "rig-error",
      }),
    ]),
  );
  #notes = new Map(NUMBERS.map(([key]) => [key, h("span.hint")]));
  #simulated = input("checkbox", "rig-simulated");
  #inUse = h("p.hint", { role: "status" });
  #error = h("p.field-error", { role: "alert", id: "rig-error" });
  #floor = button("Estimate from the floor", () => this.#estimate());
  #drive = button("Estimate while driving", () => this.#toggleDrive(), { "aria-pressed": "false" });
  #words = h("p", { role: "status" });
  /** Timer that polls the estimate while driving; 0 while not estimating. */
  #asking = 0;
  /** Estimates not yet overwritten by hand. @type {Map<string, RigNumber>} */
  #estimated = new Map();
  /** Why nothing could be estimated; errors in the fields have their own element. */
  #refusal = h("p.field-error", { role: "alert" });
  #do = exclusiveRunner(undefined, this.#refusal);
  #doDrive = exclusiveRunner(undefined, this.#refusal);
  /** True while the form holds values that are not in use yet. */
  #changed = false;
  /** Keys filled in while driving, and not otherwise since. @type {Set<string>} */
  #driven = new Set();
  /** Whether the server has a mount, so that empty fields remove it. */
  #saved = false;

  build() {
    const form = h(
      "form.stack",
      { novalidate: true },
      h(
        "div.rig-fields",
        ...NUMBERS.map(([key, words, unit, , help]) => {
          const [input, note] = [this.#inputs.get(key), this.#notes.get(key)];
          return input && note ? field(`${words}, ${unit}`, input, help, note) : null;
        }),
      ),
      h("label.check", { for: "rig-simulated" }, this.#simulated, "Also use for simulated sources"),
      this.#error,
      h(
        "div.row",
        h("button.button.primary", { type: "submit" }, "Use this mount"),
        this.#floor,
        this.#drive,
        h("a.button", { href: "/api/rig/file", download: "rig.yaml" }, "Download rig.yaml"),
      ),
      this.#refusal,
      this.#words,
    );
    this.append(
      h("h3", "Camera on the robot"),
      h(
        "p.hint",
        "Camera extrinsics: where the left camera is mounted on the robot. They level the 3D scene, set the scale for a single camera, and tell the guard where the floor is.",
      ),
      this.#inUse,
      form,
    );
    for (const [key, input] of this.#inputs) {
      input.addEventListener("input", () => {
        this.#estimated.delete(key);
        this.#driven.delete(key);
        this.#note(key, null);
        this.#accept(key);
      });
    }
    form.addEventListener("input", () => {
      this.#changed = true;
    });
    onSubmit(form, () => this.#save());
    this.listen("reconnected", () => this.#load());
    this.listen("status", () => this.#renderInUse());
    void this.#load();
  }

  disconnectedCallback() {
    super.disconnectedCallback();
    clearInterval(this.#asking);
  }

  /** Estimate from the first press to the second, and show the values meanwhile. */
  async #toggleDrive() {
    await this.#doDrive(async () => {
      const ending = this.#asking !== 0;
      clearInterval(this.#asking);
      this.#asking = 0;
      await this.#showDrive(ending ? "DELETE" : "POST");
      if (!ending)
        this.#asking = setInterval(
          () => void this.#showDrive("GET").catch(() => {}),
          DRIVE_ASKED_MS,
        );
    });
    const noting = this.#asking !== 0;
    setAttribute(this.#drive, "aria-pressed", String(noting));
    setText(this.#drive, noting ? "Stop estimating" : "Estimate while driving");
  }

  /** @param {"GET" | "POST" | "DELETE"} method */
  async #showDrive(method) {
    /** @type {DriveNow} */
    const found = await request(method, "/rig/drive");
    for (const [key, , , digits] of NUMBERS) {
      const number = found.values[key];
      const input = this.#inputs.get(key);
      // Values typed or estimated from the floor are more accurate than those from driving.
      const known = input?.value !== "" && !this.#driven.has(key);
      // A field emptied just now is about to be typed into.
      if (!number || known || input === document.activeElement) continue;
      this.#driven.add(key);
      this.#fill(key, number, digits);
    }
    setText(this.#words, sentence(found.sentence));
  }

  async #load() {
    /** @type {RigNow | null} */
    const rig = await request("GET", "/rig").catch(() => null);
    // Do not lose what was typed or estimated meanwhile.
    if (rig && !this.#changed) this.#show(rig);
  }

  /** @param {RigNow} rig */
  #show(rig) {
    this.#estimated.clear();
    this.#driven.clear();
    for (const [key, , , digits] of NUMBERS) this.#fill(key, rig.mount[key] ?? null, digits);
    this.#simulated.checked = rig.for_simulated;
    this.#saved = Object.keys(rig.mount).length > 0;
    this.#changed = false;
  }

  /** @param {string} key @param {RigNumber | null} number @param {number} digits */
  #fill(key, number, digits) {
    const input = this.#inputs.get(key);
    if (!input) return;
    this.#changed = true;
    input.value = number === null ? "" : String(Number(number.value.toFixed(digits)));
    if (number?.sigma) this.#estimated.set(key, number);
    this.#note(key, number);
    this.#accept(key);
  }

  /** Forget what was wrong with a number that has changed. @param {string} key */
  #accept(key) {
    const inputs = [...this.#inputs.values()];
    setAttribute(/** @type {Element} */ (this.#inputs.get(key)), "aria-invalid", null);
    if (!inputs.some((each) => each.getAttribute("aria-invalid"))) setText(this.#error, "");
  }

  /** @param {string} key @param {RigNumber | null} number */
  #note(key, number) {
    const note = this.#notes.get(key);
    const digits = NUMBERS.find(([each]) => each === key)?.[3] ?? 2;
    if (note)
      setText(
        note,
        number?.sigma ? `estimated, ± ${fixed(half95(number.sigma), digits)} (95 % interval)` : "",
      );
  }

  #renderInUse() {
    const mount = this.hub.status?.mount;
    setText(
      this.#inUse,
      mount
        ? `In use: ${fixed(mount.height_m, 2)} m above the floor, tilted down by ${fixed((mount.tilt_rad * 180) / Math.PI, 1)}°.`
        : "No mount set for the current source: the 3D scene is not levelled.",
    );
  }

  async #save() {
    setText(this.#error, "");
    /** @type {Record<string, RigNumber | null>} */
    const mount = {};
    for (const [key, words] of NUMBERS) {
      const input = this.#inputs.get(key);
      const text = input?.value.trim().replace(",", ".") ?? "";
      const value = Number(text);
      const wrong = text !== "" && !Number.isFinite(value);
      if (input) setAttribute(input, "aria-invalid", wrong ? "true" : null);
      if (wrong)
        return this.#refuse(key, `${words} must be a number. Leave it empty if it is unknown.`);
      mount[key] = text === "" ? null : (this.#estimated.get(key) ?? { value, sigma: null });
    }
    if (!this.#saved && Object.values(mount).every((number) => number === null))
      return this.#refuse("height_m", "Enter the height and the tilt, or estimate them.");
    try {
      /** @type {RigNow} */
      const rig = await request("PUT", "/rig", { mount, for_simulated: this.#simulated.checked });
      this.#show(rig);
      notify(this.#savedInWords(rig));
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      const key = Object.keys(error.fields).find((each) => this.#inputs.has(each));
      const words = NUMBERS.find(([each]) => each === key)?.[1];
      // The sentence begins with the name of the field in the file.
      this.#refuse(
        key,
        words && key ? error.message.replace(new RegExp(`^${key}`, "i"), words) : error.message,
      );
    }
  }

  /** @param {RigNow} rig as saved @returns {string} whether it has an effect now */
  #savedInWords({ mount, in_use, for_simulated }) {
    if (Object.keys(mount).length === 0) return "The mount was removed.";
    if (this.hub.status?.source?.spec.startsWith(SIMULATED) && !for_simulated)
      return "Saved for real cameras. This simulated source keeps its own mount.";
    return in_use
      ? "The mount is now in use."
      : "Saved. It is used once both the height and the tilt are known.";
  }

  /** @param {string | undefined} key the number that is wrong @param {string} why one sentence */
  #refuse(key, why) {
    setText(this.#error, why);
    const input = this.#inputs.get(key ?? "");
    if (!input) return;
    setAttribute(input, "aria-invalid", "true");
    input.focus();
  }

  async #estimate() {
    let words = "";
    await this.#do(
      async () => {
        /** @type {FloorEstimate & Record<string, any>} */
        const found = await request("POST", "/rig/floor");
        for (const [key, , , digits] of NUMBERS.slice(0, 3)) {
          this.#driven.delete(key);
          this.#fill(key, found[key], digits);
        }
        words = `${sentence(found.sentence)} Press “Use this mount” to apply it.`;
      },
      this.#words,
      "Estimating from the floor…",
    );
    setText(this.#words, words);
  }
}

customElements.define("observer-rig", RigPanel);
