/** A recorded image with what was found in it: boxes, speeds and the motion in the next second. */

import { h, setAttribute } from "../elements/dom.js";
import { placeLabels } from "../elements/label-places.js";
import { boxLabel, counted, fixed, stateColour } from "../elements/words.js";

/** @import { FrameEntry, FrameObstacle } from "../contract" */
/** @import { Area } from "../elements/label-places.js" */

const LABEL_PX = 12;
const LINE_PX = 2;
const HEAD_PX = 9;
// Outline of lines and words, so that they are visible on any image.
const RIM = "rgb(0 0 0 / 0.6)";
const TRUTH = "white";

/** Fills its container, with the image centred and as large as fits. */
export class FramePicture extends HTMLElement {
  #canvas = h("canvas", { role: "img" });
  #probe = h("span.colour-probe", { hidden: true });
  /** @type {ImageBitmap | null} */
  #bitmap = null;
  /** @type {FrameEntry | null} */
  #entry = null;
  /** Size of the image that the boxes refer to. */
  #size = { width: 1, height: 1 };
  #resized = new ResizeObserver(() => this.#draw());
  #themed = () => this.#draw();

  connectedCallback() {
    if (!this.childElementCount) this.append(this.#canvas, this.#probe);
    this.#resized.observe(this);
    window.addEventListener("themechange", this.#themed);
  }

  disconnectedCallback() {
    this.#resized.disconnect();
    window.removeEventListener("themechange", this.#themed);
  }

  /**
   * @param {ImageBitmap | null} bitmap closed when another is shown
   * @param {FrameEntry | null} entry what was found in it; null: not known yet
   * @param {{width: number, height: number}} size of the image that the boxes refer to
   */
  show(bitmap, entry, size) {
    if (bitmap !== this.#bitmap) this.#bitmap?.close();
    this.#bitmap = bitmap;
    this.#entry = entry;
    this.#size = size;
    setAttribute(this.#canvas, "aria-label", entry ? inWords(entry) : "No image");
    this.#draw();
  }

  #draw() {
    const { clientWidth: wide, clientHeight: high } = this;
    if (wide === 0 || high === 0) return;
    const dpr = devicePixelRatio;
    const [width, height] = [Math.round(wide * dpr), Math.round(high * dpr)];
    if (this.#canvas.width !== width || this.#canvas.height !== height)
      Object.assign(this.#canvas, { width, height });
    const context = this.#canvas.getContext("2d");
    if (!context) return;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    if (!this.#bitmap && !this.#entry) return;
    const scale = Math.min(wide / this.#size.width, high / this.#size.height);
    const left = (wide - scale * this.#size.width) / 2;
    const top = (high - scale * this.#size.height) / 2;
    context.setTransform(dpr, 0, 0, dpr, dpr * left, dpr * top);
    const [w, tall] = [scale * this.#size.width, scale * this.#size.height];
    if (this.#bitmap) context.drawImage(this.#bitmap, 0, 0, w, tall);
    if (!this.#entry) return;
    context.save();
    context.beginPath();
    context.rect(0, 0, w, tall);
    context.clip();
    const pen = new Pen(context, scale, { width: w, height: tall }, (name) => this.#resolved(name));
    for (const body of this.#entry.truth) pen.box(body.box_px, TRUTH, [5, 4]);
    for (const obstacle of this.#entry.obstacles) pen.obstacle(obstacle);
    pen.labels(this.#entry.obstacles);
    context.restore();
  }

  /** A colour of tokens.css as the canvas understands it. @param {string} name */
  #resolved(name) {
    this.#probe.style.color = `var(${name})`;
    return getComputedStyle(this.#probe).color;
  }
}

class Pen {
  /**
   * @param {CanvasRenderingContext2D} context
   * @param {number} scale CSS pixels per pixel of the image
   * @param {{width: number, height: number}} image CSS pixels
   * @param {(name: string) => string} colour
   */
  constructor(context, scale, image, colour) {
    this.context = context;
    this.scale = scale;
    this.image = image;
    this.colour = colour;
  }

  /** @param {FrameObstacle} obstacle */
  obstacle(obstacle) {
    const { state, box_px, arrow_px } = obstacle;
    const colour = stateColour(obstacle);
    this.box(box_px, colour, state === "confirmed" ? [] : [4, 4]);
    if (arrow_px) this.#arrow(arrow_px, colour);
  }

  /**
   * @param {readonly number[]} box u0, v0, u1, v1
   * @param {string} colour
   * @param {number[]} dashes
   */
  box(box, colour, dashes) {
    const [u0 = 0, v0 = 0, u1 = 0, v1 = 0] = box.map((value) => value * this.scale);
    this.context.beginPath();
    this.context.rect(u0, v0, u1 - u0, v1 - v0);
    this.#stroke(colour, dashes);
  }

  /** @param {FrameObstacle[]} obstacles */
  labels(obstacles) {
    this.context.font = `600 ${LABEL_PX}px sans-serif`;
    this.context.textBaseline = "middle";
    const wanted = obstacles.map((obstacle) => this.#wantedPlace(obstacle));
    placeLabels(wanted, this.image).forEach((place, at) => {
      const obstacle = obstacles[at];
      if (obstacle) this.#label(obstacle, place);
    });
  }

  /** Above the box, or in it at the upper edge of the image. @param {FrameObstacle} obstacle */
  #wantedPlace(obstacle) {
    const [u0 = 0, v0 = 0] = obstacle.box_px.map((value) => value * this.scale);
    const width = this.context.measureText(labelOf(obstacle)).width + 12;
    const height = LABEL_PX + 6;
    return { x: u0 - LINE_PX / 2, y: v0 - height < 0 ? v0 : v0 - height, width, height };
  }

  /** @param {FrameObstacle} obstacle @param {Area} place */
  #label(obstacle, { x, y, width, height }) {
    const { context } = this;
    context.fillStyle = this.colour("--surface");
    context.fillRect(x, y, width, height);
    context.fillStyle = stateColour(obstacle);
    context.fillRect(x, y, 4, height);
    context.fillStyle = this.colour("--text");
    context.fillText(labelOf(obstacle), x + 8, y + height / 2);
  }

  /** @param {readonly number[]} arrow @param {string} colour */
  #arrow(arrow, colour) {
    const { context } = this;
    const [u0 = 0, v0 = 0, u1 = 0, v1 = 0] = arrow.map((value) => value * this.scale);
    const angle = Math.atan2(v1 - v0, u1 - u0);
    context.beginPath();
    context.moveTo(u0, v0);
    context.lineTo(u1, v1);
    for (const side of [-1, 1]) {
      context.moveTo(u1, v1);
      context.lineTo(
        u1 - HEAD_PX * Math.cos(angle + side * 0.5),
        v1 - HEAD_PX * Math.sin(angle + side * 0.5),
      );
    }
    this.#stroke(colour, []);
  }

  /** @param {string} colour @param {number[]} dashes */
  #stroke(colour, dashes) {
    const { context } = this;
    context.lineJoin = "round";
    context.setLineDash(dashes);
    for (const [style, width] of /** @type {const} */ ([
      [RIM, LINE_PX + 2],
      [colour, LINE_PX],
    ])) {
      context.strokeStyle = style;
      context.lineWidth = width;
      context.stroke();
    }
    context.setLineDash([]);
  }
}

/** @param {FrameObstacle} obstacle */
function labelOf(obstacle) {
  return `#${obstacle.id}  ${boxLabel(obstacle)}`;
}

/** @param {FrameEntry} entry */
function inWords({ frame, plan, status, obstacles }) {
  const found = obstacles.map((each) => `obstacle ${labelOf(each)}`).join(", ");
  const said = status === "lost" ? "camera motion lost" : found || "nothing moves";
  return `Left image of frame ${frame} at ${fixed(plan.time, 2)} s, ${counted(obstacles.length, "obstacle")}: ${said}.`;
}

customElements.define("observer-frame-picture", FramePicture);
