/** Camera extrinsics on the observer's motion-capture body: typed in, or left to be estimated. */

import { button, details, field, h, input } from "../elements/dom.js";
import { fixed } from "../elements/words.js";

/** @import { CameraOnBodyFacts } from "../contract" */

/** Key, words, unit, help. @type {[keyof CameraOnBodyFacts, string, string, string][]} */
const NUMBERS = [
  ["x_m", "x", "m", "along the body's x axis"],
  ["y_m", "y", "m", "along the body's y axis"],
  ["z_m", "z", "m", "along the body's z axis"],
  ["pan_deg", "Pan", "°", "positive from the body's x axis towards its y axis"],
  ["tilt_deg", "Tilt", "°", "positive when the camera looks down"],
  ["roll_deg", "Roll", "°", "positive when the right side is lower"],
];

export class CameraOnBody extends HTMLElement {
  #inputs = new Map(
    NUMBERS.map(([key]) => [
      key,
      input("text", `camera-on-body-${key}`, { inputmode: "decimal", placeholder: "estimated" }),
    ]),
  );
  #fill = button("Fill in the estimate", () => this.#write(this.#found));
  #empty = button("Estimate automatically", () => this.#write(null));
  #details = details("Camera on the body");
  /** @type {CameraOnBodyFacts | null} */
  #found = null;

  connectedCallback() {
    if (this.firstChild) return;
    this.#details.append(
      h(
        "div.stack",
        h(
          "p.hint",
          "Pose of the left camera in the body's axes. Leave all fields empty to estimate it from the drive or take it from “Camera on the robot”. With all angles 0, the camera looks along the body's x axis with the body's z axis up.",
        ),
        h(
          "div.rig-fields",
          ...NUMBERS.map(([key, words, unit, help]) =>
            field(`${words}, ${unit}`, /** @type {HTMLElement} */ (this.#inputs.get(key)), help),
          ),
        ),
        h("div.row", this.#fill, this.#empty),
      ),
    );
    this.append(this.#details);
  }

  /** Show another run. @param {CameraOnBodyFacts | null} said typed in for its alignment */
  show(said) {
    this.#details.open = said !== null;
    this.#write(said);
  }

  /** Offer the estimated values; typed values stay. @param {CameraOnBodyFacts | null} found */
  set found(found) {
    this.#found = found;
    this.#fill.hidden = found === null;
  }

  /**
   * @returns {CameraOnBodyFacts | null} null: nothing was typed in
   * @throws {RangeError} a value is missing or not a number; one sentence
   */
  get place() {
    const texts = NUMBERS.map(([key, words]) => ({
      key,
      words,
      text: this.#inputs.get(key)?.value.trim().replace(",", ".") ?? "",
    }));
    if (texts.every(({ text }) => text === "")) return null;
    for (const { words, text } of texts) {
      if (text === "")
        throw new RangeError(
          `Camera on the body: ${words} is missing. Fill in all six numbers or none.`,
        );
      if (!Number.isFinite(Number(text)))
        throw new RangeError(
          `Camera on the body: ${words} must be a number, not ${text.slice(0, 40)}.`,
        );
    }
    return /** @type {CameraOnBodyFacts} */ (
      Object.fromEntries(texts.map(({ key, text }) => [key, Number(text)]))
    );
  }

  /** @param {CameraOnBodyFacts | null} place */
  #write(place) {
    for (const [key, input] of this.#inputs)
      input.value = place ? String(Number(place[key].toFixed(key.endsWith("_m") ? 4 : 2))) : "";
  }
}

/** @param {CameraOnBodyFacts} place */
export function placeInWords({ x_m, y_m, z_m, pan_deg, tilt_deg, roll_deg }) {
  return `${fixed(x_m, 2)}, ${fixed(y_m, 2)}, ${fixed(z_m, 2)} m; pan ${fixed(pan_deg, 1)}°, tilt ${fixed(tilt_deg, 1)}°, roll ${fixed(roll_deg, 1)}°`;
}

customElements.define("observer-camera-on-body", CameraOnBody);
