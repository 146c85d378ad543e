/** The 3D scene: the viewer in a frame, covered while what it shows is old. */

import { h, setAttribute, setText } from "./dom.js";
import { Part } from "./part.js";

// The viewer's own panel of settings (a window, or a drawer where it is narrow) and its notices;
// the page has its own. viser offers no setting for that.
const HIDE_PANEL =
  "#root .mantine-Paper-root, .mantine-Notifications-root { display: none !important }";

class Scene extends Part {
  #frame = h("iframe", {
    src: "/viewer/",
    title: "3D scene: coloured point cloud, red boxes around moving obstacles with speed arrows",
  });
  #cover = h("p", { class: "stale-mark", hidden: true });

  build() {
    this.#frame.addEventListener("load", () => this.#hidePanel());
    this.append(this.#frame, this.#cover);
    // The viewer does not reconnect by itself and would go on showing its last scene.
    this.hear("reconnected", () => this.reload());
    this.hear("freshness", () => this.#mark());
    this.#mark();
  }

  /** Load the viewer again. */
  reload() {
    this.#frame.contentWindow?.location.reload();
  }

  #hidePanel() {
    const inside = this.#frame.contentDocument;
    if (!inside?.head || inside.querySelector("#hide-panel")) return;
    const style = inside.createElement("style");
    style.id = "hide-panel";
    style.textContent = HIDE_PANEL;
    inside.head.append(style);
  }

  #mark() {
    const { state, reason } = this.hub.freshness;
    setAttribute(this, "data-freshness", state);
    this.#cover.hidden = state === "fresh";
    setText(this.#cover, state === "stale" ? `Stale: ${reason}` : reason);
  }
}

customElements.define("observer-scene", Scene);
