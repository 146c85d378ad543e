/** The 3D scene: the viewer in a frame and its controls, greyed out while stale. */

import { button, h, setAttribute, setText } from "../elements/dom.js";
import { declareKeys } from "../elements/keys.js";
import { Part } from "../elements/part.js";
import { request } from "../shell/api.js";
import { SceneControls } from "./scene-controls.js";

/** @import { SceneFacts } from "../contract" */
/** @import { FloorPlace } from "../shell/floor-pick.js" */
/** @import { FromFrame, ToFrame } from "../scene-frame/messages.js" */

declareKeys("Picking a goal", ["Esc", "Cancel, unless a robot is armed"]);

const ADDRESS = "/viewer/";
// The viewer is loaded after this even without live data.
const PATIENCE_MS = 3000;
// A viewer has started by this time after its page has loaded.
const STARTED_MS = 1000;

class Scene extends Part {
  #frame = this.#newFrame();
  #trouble = h(
    "p.scene-trouble",
    { role: "status" },
    "This browser cannot draw in 3D: it has no WebGL 2. Turn on hardware acceleration in its ",
    "settings, or use another browser. Everything else works without the 3D scene.",
  );
  #wait = h("p.scene-wait", { role: "status" }, "Loading the 3D scene…");
  #controls = new SceneControls();
  #pickWords = h("span", { role: "status" });
  #cancel = button("Cancel", () => this.hub.floorPick.cancel());
  #pick = h("div.scene-pick", { hidden: true }, this.#pickWords, this.#cancel);
  /** @type {SceneFacts | null} */
  #facts = null;

  build() {
    this.#trouble.hidden = true;
    // Hidden until there is something to control.
    this.#controls.hidden = true;
    this.append(this.#frame, this.#wait, this.#trouble, this.#controls, this.#pick);
    this.#controls.attach(this.hub);
    this.listen("message", (event) => this.#receive(/** @type {MessageEvent} */ (event)), window);
    this.listen("changed", () => this.#choose(), this.#controls.choice);
    this.listen("reset", () => this.#post({ kind: "reset" }), this.#controls);
    // The page first: without a graphics card the viewer keeps the processor busy for seconds.
    this.listen("painted", () => this.#load());
    setTimeout(() => this.#load(), PATIENCE_MS);
    this.listen("reconnected", () => this.#back());
    const { floorPick, driver } = this.hub;
    this.listen("change", () => this.#showPick(), floorPick);
    this.listen("stopping", () => floorPick.cancel(), driver);
    window.addEventListener("keydown", (event) => this.#cancelByKey(event), { capture: true });
    this.listen("freshness", () => this.#mark());
    this.listen("themechange", () => this.#paint(), window);
    this.#mark();
  }

  #newFrame() {
    const frame = h("iframe", {
      // Without our origin: it may do nothing but draw, and browsers give it its own process.
      sandbox: "allow-scripts",
      title: "3D scene: coloured point cloud, red boxes around moving obstacles with speed arrows",
    });
    frame.addEventListener("load", () =>
      setTimeout(() => this.#hideWaitIfRefused(frame), STARTED_MS),
    );
    return frame;
  }

  /** What loaded but did not start is the server's refusal: leave the frame to it. */
  #hideWaitIfRefused(/** @type {HTMLIFrameElement} */ frame) {
    if (frame.src && this.#controls.hidden) this.#wait.hidden = true;
  }

  #load() {
    if (!this.#frame.src) this.#frame.src = ADDRESS;
  }

  /** Handle the return of the server; a running viewer restores its link itself. */
  #back() {
    if (!this.#controls.hidden) {
      this.#post({ kind: "back" });
    } else if (this.#frame.src) {
      // A new frame: a second address in the old one would add an entry to the browser's history.
      this.#wait.hidden = false;
      const frame = this.#newFrame();
      this.#frame.replaceWith(frame);
      this.#frame = frame;
      this.#load();
    }
  }

  /** @param {MessageEvent} event */
  #receive({ source, data }) {
    if (source !== this.#frame.contentWindow) return;
    const message = /** @type {FromFrame} */ (data);
    if (message.kind === "ready") void this.#start(message.draws);
    else if (message.kind === "drawn") this.#wait.hidden = true;
    else if (message.kind === "taken") this.#controls.choice.camera = "free";
    else if (message.kind === "picked") this.#picked(message);
    else this.#press(message);
  }

  /** @param {boolean} draws */
  async #start(draws) {
    this.#trouble.hidden = draws;
    this.#paint();
    if (draws) this.#facts ??= await request("GET", "/scene").catch(() => null);
    if (!draws || !this.#facts) {
      // No message will say that it is drawn.
      this.#wait.hidden = true;
      return;
    }
    this.#wait.hidden = false;
    this.#controls.offer(this.#facts.layers);
    this.#controls.hidden = false;
    this.hub.floorPick.possible = true;
    this.#choose();
  }

  /** @param {{place: FloorPlace | null, known: boolean}} answer */
  #picked({ place, known }) {
    const { floorPick } = this.hub;
    if (!floorPick.asked) return;
    if (place) floorPick.answer(place);
    else if (known) floorPick.say("That is not on the floor: click again.");
    else floorPick.say("Not picked: the observer's position is unknown.", true);
  }

  #showPick() {
    const { floorPick } = this.hub;
    const base = (floorPick.asked && this.#facts?.base_node) || null;
    this.#post({ kind: "pick", base });
    setText(this.#pickWords, floorPick.words);
    setAttribute(this.#pick, "data-tone", floorPick.refused ? "bad" : null);
    this.#pick.hidden = !floorPick.words;
    this.#cancel.hidden = !floorPick.asked;
  }

  /**
   * Cancel picking on Esc. While a robot is armed, Esc has already stopped all robots instead.
   *
   * @param {KeyboardEvent} event
   */
  #cancelByKey(event) {
    const { floorPick, driver } = this.hub;
    if (event.key !== "Escape" || !floorPick.asked || driver.anyArmed) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    floorPick.cancel();
  }

  /**
   * Replay a key pressed inside the frame on the page: it stops the robots or restores the size.
   *
   * @param {{key: string, code: string}} key
   */
  #press({ key, code }) {
    const init = { key, code, bubbles: true, cancelable: true };
    this.#frame.dispatchEvent(new KeyboardEvent("keydown", init));
  }

  #choose() {
    const { choice } = this.#controls;
    const facts = this.#facts;
    if (!facts) return;
    const hidden = facts.layers.filter(({ name }) => !choice.shows(name)).map(({ node }) => node);
    this.#post({ kind: "choice", facts, hidden, camera: choice.camera });
  }

  #paint() {
    this.#post({ kind: "ground", colour: getComputedStyle(this).backgroundColor });
  }

  /** @param {ToFrame} message no secret: the frame has no origin by which to address it */
  #post(message) {
    this.#frame.contentWindow?.postMessage(message, "*");
  }

  /** Grey out the scene while stale; the headline says why. */
  #mark() {
    setAttribute(this, "data-freshness", this.hub.freshness.state);
  }
}

customElements.define("observer-scene", Scene);
