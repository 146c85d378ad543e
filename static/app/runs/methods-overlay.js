/** What a method found in a frame, drawn over the frame's image. */

import { h, setAttribute, svg } from "../elements/dom.js";
import { placeLabels } from "../elements/label-places.js";
import { boxLabel, stateColour } from "../elements/words.js";

/** @import { FrameBody, FrameEntry, FrameObstacle } from "../contract" */

// In screen pixels, regardless of the size of the image.
const HEAD_PX = 7;
const LETTERS_PX = 12;
const ABOVE_PX = 4;
// Width of a character, on average, in sizes of the letters.
const CHARACTER = 0.56;

/** An image with a drawing over it, both in the size of the rectified image. */
export class OverlaidPicture {
  #canvas = h("canvas", { role: "img" });
  #drawing = svg("svg", { "aria-hidden": "true" });
  #width = 1;
  #height = 1;
  element = h("div.methods-picture", this.#canvas, this.#drawing);

  /** @param {number} width @param {number} height */
  resize(width, height) {
    this.#width = width;
    this.#height = height;
    Object.assign(this.#canvas, { width, height });
    setAttribute(this.#drawing, "viewBox", `0 0 ${width} ${height}`);
  }

  /**
   * @param {ImageBitmap | null} image null: there is none
   * @param {FrameEntry} entry
   * @param {string} words description for screen readers
   * @param {boolean} truth whether ground truth is drawn as well
   */
  show(image, entry, words, truth) {
    const pen = this.#canvas.getContext("2d");
    if (image) pen?.drawImage(image, 0, 0, this.#width, this.#height);
    else pen?.clearRect(0, 0, this.#width, this.#height);
    setAttribute(this.#canvas, "aria-label", words);
    const scale = this.#width / Math.max(1, this.#canvas.clientWidth);
    // Draw false detections last, so that none is hidden behind another.
    const order = [...entry.obstacles].sort((a, b) => Number(a.false) - Number(b.false));
    // All labels above all boxes.
    this.#drawing.replaceChildren(
      ...(truth ? entry.truth.map(trueBox) : []),
      ...order.map((obstacle) => found(obstacle, scale)),
      ...this.#labels(order, scale),
    );
  }

  /** @param {FrameObstacle[]} obstacles @param {number} scale image pixels per pixel of the screen */
  #labels(obstacles, scale) {
    const size = LETTERS_PX * scale;
    const above = ABOVE_PX * scale;
    const texts = obstacles.map(labelOf);
    const wanted = obstacles.map(({ box_px: [left = 0, top = 0] }, at) => ({
      x: left,
      y: top - above - size,
      width: CHARACTER * size * (texts[at]?.length ?? 0),
      height: size + above / 2,
    }));
    return placeLabels(wanted, { width: this.#width, height: this.#height }).map(({ x, y }, at) =>
      svg(
        "text",
        {
          ...look(/** @type {FrameObstacle} */ (obstacles[at])),
          x,
          y: y + size,
          "font-size": size,
          "stroke-width": size / 4,
        },
        texts[at] ?? "",
      ),
    );
  }
}

/** @param {FrameObstacle} obstacle @param {number} scale image pixels per pixel of the screen */
function found(obstacle, scale) {
  return svg(
    "g",
    look(obstacle),
    ...(obstacle.silhouette ?? []).map((polygon) =>
      svg("polygon", { points: polygon.map((point) => point.join(",")).join(" ") }),
    ),
    svg("rect", rectangle(obstacle.box_px)),
    ...(obstacle.arrow_px ? [arrow(obstacle.arrow_px, HEAD_PX * scale)] : []),
  );
}

/** @param {FrameObstacle} obstacle */
function labelOf(obstacle) {
  const words = boxLabel(obstacle);
  return obstacle.false ? `false, ${words}` : words;
}

/** Return the attributes of a drawing; the style sheet colours a false one. @param {FrameObstacle} obstacle */
function look(obstacle) {
  if (obstacle.false) return { "data-kind": "false" };
  return { "data-kind": "true", color: stateColour(obstacle) };
}

/** @param {FrameBody} body */
function trueBox({ box_px: box }) {
  return svg("rect", { "data-kind": "truth", ...rectangle(box) });
}

/** @param {number[]} box */
function rectangle([left = 0, top = 0, right = 0, bottom = 0]) {
  return { x: left, y: top, width: Math.max(0, right - left), height: Math.max(0, bottom - top) };
}

/** @param {number[]} ends @param {number} head length of its head */
function arrow([x0 = 0, y0 = 0, x1 = 0, y1 = 0], head) {
  const length = Math.hypot(x1 - x0, y1 - y0);
  const [u, v] = length > 0 ? [(x1 - x0) / length, (y1 - y0) / length] : [0, 0];
  const size = Math.min(head, length / 2);
  const barb = (/** @type {number} */ side) =>
    `${x1 - size * (u + side * 0.6 * v)} ${y1 - size * (v - side * 0.6 * u)}`;
  return svg("path", {
    class: "arrow",
    d: `M${x0} ${y0}L${x1} ${y1}M${barb(1)}L${x1} ${y1}L${barb(-1)}`,
  });
}
