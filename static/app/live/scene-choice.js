/** Which layers of the 3D scene the user sees, and from where; remembered in this browser. */

import { Emitter } from "../shell/emitter.js";

/** @typedef {keyof typeof CAMERAS} CameraChoice */

const KEY = "dynamic-observer.scene";

export const CAMERAS = {
  follow: { title: "Follow", help: "Behind the robot, turning with it" },
  free: { title: "Free", help: "Drag to orbit, scroll to zoom" },
  top_down: { title: "Top-down", help: "From above, with the initial heading at the top" },
};

/** Fires `changed`. */
export class SceneChoice extends Emitter {
  /** @type {Set<string>} */
  #hidden;
  /** @type {CameraChoice} */
  #camera;
  #store;

  /** @param {Pick<Storage, "getItem" | "setItem">} store */
  constructor(store = localStorage) {
    super();
    this.#store = store;
    const { hidden, camera } = parseStored(store.getItem(KEY));
    this.#hidden = new Set(hidden);
    this.#camera = camera;
  }

  get camera() {
    return this.#camera;
  }

  set camera(camera) {
    if (camera === this.#camera) return;
    this.#camera = camera;
    this.#keep();
  }

  /** @param {string} layer */
  shows(layer) {
    return !this.#hidden.has(layer);
  }

  /** @param {string} layer @param {boolean} shown */
  show(layer, shown) {
    if (shown) this.#hidden.delete(layer);
    else this.#hidden.add(layer);
    this.#keep();
  }

  #keep() {
    const value = { hidden: [...this.#hidden], camera: this.#camera };
    this.#store.setItem(KEY, JSON.stringify(value));
    this.emit("changed");
  }
}

/** @param {string | null} text @returns {{hidden: string[], camera: CameraChoice}} */
function parseStored(text) {
  /** @type {{hidden?: unknown, camera?: unknown} | null} */
  let value = null;
  try {
    value = JSON.parse(text ?? "null");
  } catch {
    // Not a value we stored.
  }
  const { hidden, camera } = value ?? {};
  return {
    hidden: Array.isArray(hidden) ? hidden.filter((name) => typeof name === "string") : [],
    camera: isCamera(camera) ? camera : "free",
  };
}

/** @param {unknown} camera @returns {camera is CameraChoice} */
function isCamera(camera) {
  return typeof camera === "string" && Object.hasOwn(CAMERAS, camera);
}
