/** The 3D scene: the viewer in a frame, covered while what it shows is old. */

import { h, setAttribute, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { paceFrames } from "./frame-pace.js";

// Where the viewer draws nothing it shows its own ground, which follows the page's colours.
const GROUND =
  '#root div[style*="background-color"]:has(canvas) { background-color: COLOUR !important }';
// The viewer's own panel of settings (a window, or a drawer where it is narrow) and its notices;
// the page has its own. viser offers no setting for that.
const HIDE_PANEL =
  "#root .mantine-Paper-root, .mantine-Notifications-root { display: none !important }";

class Scene extends Part {
  #frame = h("iframe", {
    src: "/viewer/",
    title: "3D scene: coloured point cloud, red boxes around moving obstacles with speed arrows",
  });
  /** @type {HTMLStyleElement | null} */
  #style = null;
  #cover = h("p.stale-mark", { hidden: true });

  build() {
    this.#frame.addEventListener("load", () => this.#adapt());
    this.append(this.#frame, this.#cover);
    // The viewer does not reconnect by itself and would go on showing its last scene.
    this.hear("reconnected", () => this.reload());
    this.hear("freshness", () => this.#mark());
    this.hear("themechange", () => this.#restyle(), window);
    this.#mark();
  }

  /** Load the viewer again. */
  reload() {
    this.#frame.contentWindow?.location.reload();
  }

  #adapt() {
    const { contentDocument: inside, contentWindow } = this.#frame;
    if (!inside?.head || !contentWindow) return;
    this.#style = inside.head.appendChild(inside.createElement("style"));
    this.#restyle();
    this.hub.driver.listenForStop(contentWindow);
    paceFrames(/** @type {Window & typeof globalThis} */ (contentWindow), this.hub);
  }

  #restyle() {
    const colour = getComputedStyle(this).backgroundColor;
    if (this.#style) this.#style.textContent = `${HIDE_PANEL} ${GROUND.replace("COLOUR", colour)}`;
  }

  #mark() {
    const { state, reason } = this.hub.freshness;
    setAttribute(this, "data-freshness", state);
    this.#cover.hidden = state === "fresh";
    setText(this.#cover, state === "stale" ? `Stale: ${reason}` : reason);
  }
}

customElements.define("observer-scene", Scene);
