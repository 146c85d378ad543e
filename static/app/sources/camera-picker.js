/** The cameras that are plugged in: which is left, which right, and how they are set. */

import {
  button,
  details,
  field,
  fillList,
  h,
  input,
  offer,
  onSubmit,
  select,
  setText,
} from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";

/** @import { Devices, VideoDevice } from "../contract" */

/** Settings of a camera, by their keys in a source's text. @type {[string, string, string][]} */
const SETTINGS = [
  ["exposure", "Exposure, 100 µs", "auto, or a number such as 156"],
  ["gain", "Gain", "auto or a number"],
  ["white_balance", "White balance, K", "auto, or a number such as 4600"],
  ["focus", "Focus", "auto or a number; a calibration is valid for one focus setting"],
];

export class CameraPicker extends Part {
  /** Called with the text that names the chosen cameras. @type {(spec: string) => void} */
  chosen = () => {};

  #words = h("p.hint", { role: "status" });
  #left = h("select", { id: "camera-left" });
  #right = h("select", { id: "camera-right" });
  #mode = h("select", { id: "camera-mode" });
  #line = select({ id: "camera-line" }, [
    ["", "Unchanged"],
    ["50", "50 Hz"],
    ["60", "60 Hz"],
    ["auto", "Automatic"],
  ]);
  #settings = new Map(
    SETTINGS.map(([key]) => [key, input("text", `camera-${key}`, { placeholder: "unchanged" })]),
  );
  #form = h("form.stack", { hidden: true });
  #again = button("Find cameras", () => this.#load());
  #troubles = h("ul.plain-list.warnings");
  /** @type {VideoDevice[]} */
  #cameras = [];
  /** True where there were cameras to choose from at the last look. */
  #known = false;

  build() {
    const use = h("button.button.primary", { type: "submit" }, "Open these cameras");
    this.#form.append(
      field("Left camera", this.#left),
      field("Right camera", this.#right),
      field("Size, format and rate", this.#mode),
      details(
        "Exposure, gain, focus",
        h(
          "div.stack",
          h(
            "p.hint",
            "A number turns off automatic control and locks the value. It applies to both cameras.",
          ),
          ...SETTINGS.map(([key, words, help]) => {
            const input = this.#settings.get(key);
            return input ? field(words, input, help) : null;
          }),
          field("Mains frequency, to avoid flicker", this.#line),
        ),
      ),
      h("div.row", use),
    );
    this.append(
      h("h3", "Connected cameras"),
      this.#words,
      this.#troubles,
      this.#form,
      h("div.row", this.#again),
    );
    this.#left.addEventListener("change", () => this.#renderModes(null));
    onSubmit(this.#form, () => this.chosen(this.#spec()));
    this.hear("reconnected", () => this.#load());
    void this.#load();
  }

  async #load() {
    /** @type {Pick<Devices, "cameras" | "hints">} */
    const { cameras, hints } = await request("GET", "/devices").catch(() => ({
      cameras: [],
      hints: [],
    }));
    this.#cameras = cameras.filter((camera) => !camera.trouble);
    const count = this.#cameras.length;
    setText(
      this.#words,
      count === 0
        ? "No usable camera is connected to the server."
        : count === 1
          ? "One camera is connected. It works only if it delivers both images side by side."
          : `${count} cameras are connected.`,
    );
    const troubles = cameras.flatMap((camera) => camera.trouble ?? []);
    fillList(this.#troubles, [...troubles, ...hints]);
    this.#form.hidden = count === 0;
    const known = this.#known;
    this.#known = count > 0;
    const named = this.#cameras.map((each) => [
      nameOf(each),
      `${each.path}: ${each.card ?? "camera"}`,
    ]);
    const choices = [...named, ["", "None: the left camera delivers both images"]];
    offer(this.#left, named);
    offer(this.#right, choices, known ? this.#right.value : null, choices[Math.min(1, count)]?.[0]);
    this.#renderModes(known ? this.#mode.value : null);
  }

  /** @param {string | null} chosen */
  #renderModes(chosen) {
    const camera = this.#cameras.find((each) => nameOf(each) === this.#left.value);
    const modes = (camera?.modes ?? []).map(({ pixel_format, width, height, rates }) => {
      const rate = rates[0];
      const value = new URLSearchParams({
        size: `${width}x${height}`,
        format: pixel_format,
        ...(rate ? { rate: String(rate) } : {}),
      });
      const words = `${width} × ${height}, ${pixel_format}${rate ? `, ${rate} fps` : ""}`;
      return [value.toString(), words];
    });
    // Compressed images of the usual size are what two cameras on one port can carry.
    const usual = modes.find(([, words]) => words?.startsWith("640 × 480, MJPG"));
    offer(this.#mode, [["", "Unchanged"], ...modes], chosen, usual?.[0]);
  }

  #spec() {
    const query = new URLSearchParams(this.#mode.value);
    for (const [key, input] of this.#settings)
      if (input.value.trim()) query.set(key, input.value.trim());
    if (this.#line.value) query.set("power_line", this.#line.value);
    const names = this.#right.value
      ? `${this.#left.value},${this.#right.value}`
      : `sbs:${this.#left.value}`;
    const text = query.toString();
    return `camera:${names}${text ? `?${text}` : ""}`;
  }
}

/** @param {VideoDevice} camera @returns {string} the name that stays when it is plugged in again */
function nameOf(camera) {
  return camera.by_path ?? camera.path;
}

customElements.define("observer-camera-picker", CameraPicker);
