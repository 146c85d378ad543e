/** The 3D scene: the viewer in a frame and its controls, without colours while it is old. */

import { h, setAttribute } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { paceFrames } from "./frame-pace.js";
import { SceneCamera, listenForHand } from "./scene-camera.js";
import { SceneClient } from "./scene-client.js";
import { SceneControls } from "./scene-controls.js";

/** @import { SceneFacts } from "../contract" */

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
  #controls = new SceneControls();
  /** @type {SceneFacts | null} */
  #facts = null;
  /** @type {SceneClient | null} */
  #client = null;
  /** @type {SceneCamera | null} */
  #camera = null;

  build() {
    this.#frame.addEventListener("load", () => this.#adapt());
    // Until there is something to control.
    this.#controls.hidden = true;
    this.append(this.#frame, this.#controls);
    this.#controls.attach(this.hub);
    this.hear("changed", () => this.#choose(), this.#controls.choice);
    this.hear("reset", () => this.#camera?.reset(), this.#controls);
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
    // Instead of the viewer there may be the sentence why it is not there.
    const viewer = inside.querySelector("#root") !== null;
    this.#client = viewer ? new SceneClient(contentWindow) : null;
    this.#camera = null;
    if (!viewer) {
      this.#controls.hidden = true;
      return;
    }
    this.#controls.enlarge.listenIn(inside);
    listenForHand(contentWindow, () => (this.#controls.choice.camera = "free"));
    paceFrames(/** @type {Window & typeof globalThis} */ (contentWindow), this.hub, () =>
      this.#drawn(),
    );
    void this.#learn(this.#client);
  }

  /** Read what there is to choose from. @param {SceneClient | null} client */
  async #learn(client) {
    /** @type {SceneFacts | null} */
    const facts = await request("GET", "/scene").catch(() => null);
    if (!facts || !client || client !== this.#client) return;
    this.#facts = facts;
    this.#camera = new SceneCamera(client, facts);
    this.#controls.offer(facts.layers);
    this.#controls.hidden = false;
    this.#choose();
  }

  #choose() {
    if (!this.#camera) return;
    const { camera } = this.#controls.choice;
    const moved = this.#camera.choice !== camera;
    this.#camera.choice = camera;
    if (moved && camera !== "free") this.#camera.reset();
    this.#drawn();
  }

  /** Have the viewer show what was chosen; it begins with everything, also after it lost its link. */
  #drawn() {
    const { choice } = this.#controls;
    for (const { name, node } of this.#facts?.layers ?? []) {
      const shown = this.#client?.shows(node) ?? null;
      if (shown !== null && shown !== choice.shows(name)) this.#client?.show(node, !shown);
    }
    this.#camera?.step(performance.now());
  }

  #restyle() {
    const colour = getComputedStyle(this).backgroundColor;
    if (this.#style) this.#style.textContent = `${HIDE_PANEL} ${GROUND.replace("COLOUR", colour)}`;
  }

  /** What is old loses its colours; the first line says why. */
  #mark() {
    setAttribute(this, "data-freshness", this.hub.freshness.state);
  }
}

customElements.define("observer-scene", Scene);
