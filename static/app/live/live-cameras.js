/** State of a live source's cameras: accepted settings, time skew, troubles. */

import { h, setText } from "../elements/dom.js";
import { figureList } from "../elements/figure-list.js";
import { Part } from "../elements/part.js";
import { counted, fixed } from "../elements/words.js";

/** @import { LiveCamera, LiveStatus } from "../contract" */

const SIDES = { left: "Left camera", right: "Right camera", both: "Camera" };
const STATES = { open: "streaming", waiting: "reconnecting", failed: "cannot be opened" };

class LiveCameras extends Part {
  #trouble = h("p.field-error", { role: "alert" });
  #skew = h("p");
  #counts = h("p.hint");
  #cameras = h("div.stack");
  #hints = h("ul.plain-list");
  #drawn = "";

  build() {
    this.append(
      h("h3", "Cameras"),
      this.#trouble,
      this.#skew,
      this.#counts,
      this.#cameras,
      this.#hints,
    );
    this.listen("status", () => this.#render());
  }

  #render() {
    const live = this.hub.status?.live ?? null;
    this.hidden = live === null;
    if (!live) return;
    setText(this.#trouble, live.trouble ?? "");
    setText(this.#skew, skewWords(live));
    setText(
      this.#counts,
      `${counted(live.pairs, "pair")}, ${live.dropped} dropped (left and right more than half a frame apart), reconnected ${counted(live.reopened, "time")}.`,
    );
    const drawn = JSON.stringify([live.cameras, live.hints]);
    if (drawn === this.#drawn) return;
    this.#drawn = drawn;
    this.#cameras.replaceChildren(...live.cameras.map(camera));
    this.#hints.replaceChildren(...live.hints.map((hint) => h("li", hint)));
  }
}

/** @param {LiveCamera} each */
function camera({ side, device, state, trouble, settings, refused }) {
  return h(
    "div.live-camera",
    h("p", h("b", SIDES[side]), ` ${STATES[state]}`, h("br"), h("code", device)),
    trouble ? h("p.field-error", trouble) : null,
    figureList(Object.entries(settings)),
    refused.length
      ? h("ul.plain-list.warnings", ...refused.map((reason) => h("li", reason)))
      : null,
  );
}

/** @param {LiveStatus} live */
function skewWords({ cameras, skew_median_s, skew_p95_s }) {
  if (cameras.length < 2) return "One camera provides both images at the same instant.";
  if (skew_median_s === null) return "Sync error unknown: waiting for more pairs.";
  return `Sync error between left and right: median ${fixed(1000 * skew_median_s, 1)} ms, 95th percentile ${fixed(1000 * (skew_p95_s ?? 0), 1)} ms. The 3D motion estimate accounts for it.`;
}

customElements.define("observer-live-cameras", LiveCameras);
