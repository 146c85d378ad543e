/** The connected cameras: which is left, which is right, and their settings. */

import {
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
import { ApiError, request } from "../shell/api.js";
import { showError } from "../shell/notice.js";
import { cameraSpec, modesOf, nameOf, defaultMode } from "./choices.js";
import { LatestRequest } from "../elements/latest-request.js";

/** @import { Devices, VideoDevice } from "../contract" */

/** Camera settings by their keys in a source spec. @type {[string, string, string][]} */
const SETTINGS = [
  ["exposure", "Exposure, 100 µs", "auto, or a number such as 156"],
  ["gain", "Gain", "auto or a number"],
  ["white_balance", "White balance, K", "auto, or a number such as 4600"],
  ["focus", "Focus", "auto or a number; a calibration is valid for one focus setting"],
];

export class CameraPicker extends Part {
  /**
   * Called with the source spec of the chosen cameras, the button pressed, and the element that
   * shows why they cannot be opened.
   *
   * @type {(spec: string, pressed: HTMLElement, error: HTMLElement) => void}
   */
  chosen = () => {};

  /** Called with the cameras that can be used. @type {(cameras: VideoDevice[]) => void} */
  found = () => {};

  #words = h("p.hint", { role: "status" }, "Looking for cameras…");
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
  #use = h("button.button.primary", { type: "submit" }, "Open these cameras");
  #more = details("Left and right, image size, exposure", this.#form);
  #troubles = h("ul.plain-list.warnings");
  #listError = h("p.field-error", { role: "alert" });
  #error = h("p.field-error", { role: "alert", id: "camera-error" });
  #latestDevices = new LatestRequest();
  /** @type {VideoDevice[]} */
  #cameras = [];
  /** Whether there were cameras to choose from at the last look. */
  #known = false;

  build() {
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
      this.#error,
      h("div.row", this.#use),
    );
    this.append(this.#listError, this.#words, this.#troubles, this.#more);
    this.#left.addEventListener("change", () => this.#renderModes(null));
    onSubmit(this.#form, () => this.chosen(this.#spec(), this.#use, this.#error));
    this.listen("reconnected", () => this.look());
    void this.look();
  }

  /** Look for cameras; only the answer to the newest look counts. */
  async look() {
    showError(this.#listError, "");
    try {
      /** @type {Devices | undefined} */
      const devices = await this.#latestDevices.run(() => request("GET", "/devices"));
      if (devices) this.#show(devices);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      // Cameras found before may still be connected.
      showError(this.#listError, error.message);
      if (!this.#known) setText(this.#words, "");
    }
  }

  /** @param {Pick<Devices, "cameras" | "hints">} devices */
  #show({ cameras, hints }) {
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
    this.#form.hidden = this.#more.hidden = count === 0;
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
    this.found(this.#cameras);
  }

  /** @param {string | null} chosen */
  #renderModes(chosen) {
    const camera = this.#cameras.find((each) => nameOf(each) === this.#left.value);
    offer(this.#mode, [["", "Unchanged"], ...modesOf(camera)], chosen, defaultMode(camera));
  }

  #spec() {
    const query = new URLSearchParams(this.#mode.value);
    for (const [key, input] of this.#settings)
      if (input.value.trim()) query.set(key, input.value.trim());
    if (this.#line.value) query.set("power_line", this.#line.value);
    return cameraSpec(this.#left.value, this.#right.value, query.toString());
  }
}

customElements.define("observer-camera-picker", CameraPicker);
