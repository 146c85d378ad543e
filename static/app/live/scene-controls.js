/** The controls over the 3D scene: its legend, which also toggles layers, and its camera. */

import { button, h, svg } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { EnlargeButton } from "./enlarge-button.js";
import { CAMERAS, SceneChoice } from "./scene-choice.js";

/** @import { SceneLayer } from "../contract" */
/** @import { CameraChoice } from "./scene-choice.js" */

const HOME_ICON = "M8 2 1.5 7.6l1 1.2 1-.8v5.5h3.7V10h1.6v3.5h3.7V8l1 .8 1-1.2z";

/** Fires `reset` when the view is reset; everything else is in `choice`. */
export class SceneControls extends Part {
  choice = new SceneChoice();
  enlarge = new EnlargeButton();
  #layers = h("fieldset.chips.scene-layers", { id: "scene-layers" });
  // Opens the list of layers where there is no room for all of them.
  #open = button("Layers", () => this.#openLayers(), {
    class: "button scene-open-layers",
    "aria-controls": "scene-layers",
    "aria-expanded": "false",
  });
  /** @type {[CameraChoice, HTMLInputElement][]} */
  #cameras = [];

  build() {
    this.#layers.append(h("legend.visually-hidden", "Layers shown"));
    const cameras = h("fieldset.segmented", h("legend.visually-hidden", "Camera"));
    for (const [name, { title, help }] of Object.entries(CAMERAS)) {
      const camera = /** @type {CameraChoice} */ (name);
      const radio = h("input", { type: "radio", name: "scene-camera", value: name });
      radio.addEventListener("change", () => (this.choice.camera = camera));
      cameras.append(h("label", { title: help }, radio, title));
      this.#cameras.push([camera, radio]);
    }
    const reset = button(
      [
        svg(
          "svg",
          { viewBox: "0 0 16 16", class: "icon", "aria-hidden": "true" },
          svg("path", { d: HOME_ICON }),
        ),
        h("span.reset-word", "Reset view"),
      ],
      () => this.dispatchEvent(new Event("reset")),
      { class: "button scene-reset", "aria-label": "Reset view", title: "Show the robot again" },
    );
    this.enlarge.name = "3D scene";
    this.enlarge.what = this.closest(".stage") ?? this.enlarge.what;
    this.enlarge.attach(this.hub);
    this.append(h("div.scene-tools", this.#open, cameras, reset, this.enlarge), this.#layers);
    this.listen("changed", () => this.#render(), this.choice);
    this.#render();
  }

  /** @param {readonly SceneLayer[]} layers */
  offer(layers) {
    const chips = layers.map((layer) => {
      const box = h("input", { type: "checkbox", name: "layer", value: layer.name });
      box.checked = this.choice.shows(layer.name);
      box.addEventListener("change", () => this.choice.show(layer.name, box.checked));
      return h("label", { title: layer.help }, box, layerSwatch(layer.colors), layer.title);
    });
    this.#layers.replaceChildren(h("legend.visually-hidden", "Layers shown"), ...chips);
  }

  #openLayers() {
    const open = this.toggleAttribute("data-open");
    this.#open.setAttribute("aria-expanded", String(open));
  }

  #render() {
    for (const [name, radio] of this.#cameras) radio.checked = name === this.choice.camera;
  }
}

/** @param {readonly (readonly number[])[]} colours RGB; empty: the colours of an image */
function layerSwatch(colours) {
  const swatch = h("span.swatch", { "aria-hidden": "true" });
  const stops = colours.map((rgb, at) => {
    const [from, to] = [at, at + 1].map((edge) => `${(100 * edge) / colours.length}%`);
    return `rgb(${rgb.join(" ")}) ${from} ${to}`;
  });
  if (stops.length > 0)
    swatch.style.setProperty("--swatch", `linear-gradient(90deg, ${stops.join(", ")})`);
  else swatch.dataset.kind = "points";
  return swatch;
}

customElements.define("observer-scene-controls", SceneControls);
