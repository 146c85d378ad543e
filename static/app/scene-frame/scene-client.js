/** Access to viser's client in its page: what it shows and from where, in this browser alone. */

/** @typedef {[number, number, number]} Vector */

/**
 * @typedef {object} Frame a node of the scene, in the axes of the viewer's renderer
 * @property {Vector} position
 * @property {Vector} x its unit axes
 * @property {Vector} y
 * @property {Vector} z
 */

/**
 * @typedef {object} Ray in the axes of the viewer's renderer
 * @property {Vector} from
 * @property {Vector} along not of unit length
 */

/**
 * @typedef {object} ViewerCamera matrices in column-major order
 * @property {{x: number, y: number, z: number}} position
 * @property {{elements: number[]}} matrixWorld
 * @property {{elements: number[]}} projectionMatrixInverse
 */

/**
 * @typedef {object} Viewer what viser's client exposes to the page (meant for its tests)
 * @property {object[]} messageQueue handled before the next drawing, as if sent by the server
 * @property {() => void} requestRender
 * @property {Record<string, {matrixWorld: {elements: number[]}} | undefined>} nodeRefFromName
 * @property {HTMLCanvasElement | null} canvas
 * @property {ViewerCamera | null} camera
 * @property {{setLookAt: (...place: [number, number, number, number, number, number, boolean]) =>
 *   unknown} | null} cameraControl
 */

/**
 * @typedef {Window & {__viserMutable?: Viewer, __viserSceneTree?: {getState: () =>
 *   Record<string, {visibility?: boolean} | undefined>}}} ViewerWindow
 */

/**
 * Nothing done here reaches the server or another viewer. If the client has not started, or is of
 * another version, the methods do nothing.
 */
export class SceneClient {
  #inside;

  /** @param {Window} inside the frame's window */
  constructor(inside) {
    this.#inside = /** @type {ViewerWindow} */ (inside);
  }

  /** @param {string} node @returns {boolean | null} null: there is no such node */
  shows(node) {
    const entry = this.#inside.__viserSceneTree?.getState()[node];
    return entry ? (entry.visibility ?? true) : null;
  }

  /** @param {string} node @param {boolean} visible it and everything below it */
  show(node, visible) {
    const viewer = this.#inside.__viserMutable;
    if (!viewer || this.shows(node) === null) return;
    viewer.messageQueue.push({
      type: "SetSceneNodeVisibilityMessage",
      name: node,
      owner: "",
      visible,
    });
    viewer.requestRender();
  }

  /** @param {string} node @returns {Frame | null} as it was last drawn */
  frame(node) {
    const elements = this.#inside.__viserMutable?.nodeRefFromName[node]?.matrixWorld.elements;
    if (!elements) return null;
    const [x, y, z, position] = [0, 4, 8, 12].map(
      (at) => /** @type {Vector} */ (elements.slice(at, at + 3)),
    );
    return x && y && z && position ? { position, x, y, z } : null;
  }

  /** @returns {Vector | null} position of the camera */
  eye() {
    const { x, y, z } = this.#inside.__viserMutable?.camera?.position ?? {};
    return x === undefined || y === undefined || z === undefined ? null : [x, y, z];
  }

  /**
   * Return the ray through a point of the window, as last drawn.
   *
   * @param {number} x px of the window
   * @param {number} y
   * @returns {Ray | null}
   */
  ray(x, y) {
    const { camera, canvas } = this.#inside.__viserMutable ?? {};
    const box = canvas?.getBoundingClientRect();
    if (!camera || !box?.width || !box.height) return null;
    const right = (2 * (x - box.left)) / box.width - 1;
    const up = 1 - (2 * (y - box.top)) / box.height;
    const far = placed(camera.projectionMatrixInverse.elements, [right, up, 0.5]);
    const from = placed(camera.matrixWorld.elements, [0, 0, 0]);
    const to = placed(camera.matrixWorld.elements, far);
    return { from, along: [to[0] - from[0], to[1] - from[1], to[2] - from[2]] };
  }

  /** @param {Vector} eye @param {Vector} target */
  look(eye, target) {
    this.#inside.__viserMutable?.cameraControl?.setLookAt(...eye, ...target, false);
  }
}

/**
 * @param {number[]} matrix 4 by 4, column-major
 * @param {Vector} point
 * @returns {Vector}
 */
function placed(matrix, [x, y, z]) {
  const row = (/** @type {number} */ at) =>
    (matrix[at] ?? 0) * x +
    (matrix[at + 4] ?? 0) * y +
    (matrix[at + 8] ?? 0) * z +
    (matrix[at + 12] ?? 0);
  const w = row(3);
  return [row(0) / w, row(1) / w, row(2) / w];
}
