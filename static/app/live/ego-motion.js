/** Ego-motion, which is compensated before anything counts as moving. */

import { h, setText } from "../elements/dom.js";
import { fillFigures } from "../elements/figure-list.js";
import { GLOSSARY } from "../elements/glossary.js";
import { Part } from "../elements/part.js";
import { fixed } from "../elements/words.js";

/** @import { EgoMotionStatus } from "../contract" */

/** @import { Figure } from "../elements/figure-list.js" */

const DEG = 180 / Math.PI;

class EgoMotionPanel extends Part {
  #about = h("p.hint");
  #imageFigures = h("dl.figures");
  #image = h("div.stack", h("h4", "Image motion"), this.#imageFigures);
  #cameraFigures = h("dl.figures");
  #camera = h("div.stack", h("h4", "3D motion: right, down, forward"), this.#cameraFigures);

  build() {
    this.append(
      h("h3", { title: GLOSSARY["ego-motion"] }, "Camera motion"),
      this.#about,
      this.#image,
      this.#camera,
    );
    this.listen("status", () => this.#render());
    this.#render();
  }

  #render() {
    const ego = this.hub.status?.ego_motion ?? null;
    const parts = ego?.decomposition ?? null;
    const motion = ego?.motion ?? null;
    setText(this.#about, ego ? summary(ego) : "No data yet: no two frames have been compared.");
    this.#image.hidden = !parts;
    this.#camera.hidden = !motion;
    if (parts) fillFigures(this.#imageFigures, imageFigures(parts));
    if (motion) fillFigures(this.#cameraFigures, cameraFigures(motion));
  }
}

/** @param {EgoMotionStatus} ego */
function summary({ model, status, matches, inliers, dt }) {
  const since = dt === null ? "" : ` over ${fixed(1000 * dt, 0)} ms`;
  if (status === "lost")
    return `Camera motion lost with the ${model} method${since}: no single motion fits the ${matches} matches.`;
  return `Estimated with the ${model} method${since}: ${inliers} of ${matches} matches agree${status === "ok" ? "" : " (weak estimate)"}.`;
}

/** @param {NonNullable<EgoMotionStatus["decomposition"]>} parts @returns {Figure[]} */
function imageFigures({ translation_px, rotation_rad, shear, scale }) {
  return [
    ["Translation", `${joinFixed(translation_px, 2)} px`],
    ["Rotation", `${fixed(DEG * rotation_rad, 3)}°`],
    ["Shear", fixed(shear, 4)],
    ["Scale", joinFixed(scale, 4)],
  ];
}

/** @param {NonNullable<EgoMotionStatus["motion"]>} motion @returns {Figure[]} */
function cameraFigures({ translation_m, rotation_rad }) {
  const millimetres = translation_m.map((m) => 1000 * m);
  const degrees = rotation_rad.map((a) => DEG * a);
  return [
    ["Translation", `${joinFixed(millimetres, 1)} mm`],
    ["Rotation", `${joinFixed(degrees, 2)}°`],
  ];
}

/**
 * @param {number[]} values
 * @param {number} digits
 */
function joinFixed(values, digits) {
  return values.map((value) => fixed(value, digits)).join(", ");
}

customElements.define("observer-ego-motion", EgoMotionPanel);
