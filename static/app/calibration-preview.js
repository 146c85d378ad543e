/** A calibration before it is used: what was understood, and the newest pair rectified by it. */

import { requestImage } from "./api.js";
import { h, setText } from "./dom.js";
import { fixed } from "./words.js";

/** @typedef {import("./types.js").Calibration} Calibration */

const GOOD_PX = 0.5;
const POOR_PX = 1.5;

/**
 * Show it over the page until it is closed.
 *
 * @param {Calibration} calibration
 * @param {boolean} active whether it is in use already
 * @param {string} [words] what is to be known of it beside its figures
 * @returns {Promise<boolean>} whether to use it
 */
export function previewed(calibration, active, words = "") {
  const canvas = h("canvas", { width: 4, height: 1, role: "img", "aria-label": "The rectified pair, left and right, with level lines across both" });
  const verdict = h("p", { class: "verdict", role: "status" }, "Rectifying the newest pair…");
  const use = h("button", { value: "use", class: "button primary", disabled: active }, active ? "In use" : "Use this calibration");
  const dialog = h(
    "dialog",
    { class: "preview", "aria-labelledby": "preview-title" },
    h(
      "form",
      { method: "dialog" },
      h("h2", { id: "preview-title" }, calibration.name),
      words ? h("p", {}, words) : null,
      h("dl", { class: "figures" }, ...understood(calibration)),
      canvas,
      h("p", { class: "hint" }, "A point of the left image must lie on the same level line in the right one."),
      verdict,
      h("div", { class: "row end" }, h("button", { value: "close", class: "button" }, "Close"), use),
    ),
  );
  document.body.append(dialog);
  dialog.showModal();
  void paintPreview(`/calibrations/${encodeURIComponent(calibration.id)}/preview`, canvas, verdict);
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue === "use");
    });
  });
}

/** @param {Calibration} c @returns {string} its facts in one line */
export function describe(c) {
  return `${c.width} × ${c.height} · baseline ${fixed(c.baseline_m, 3)} m · ${fixed(c.hfov_deg, 1)}° wide`;
}

/**
 * Draw a rectified pair and judge its rows.
 *
 * @param {string} path below /api
 * @param {HTMLCanvasElement} canvas
 * @param {HTMLElement} verdict
 */
export async function paintPreview(path, canvas, verdict) {
  try {
    const { blob, headers } = await requestImage(path);
    const bitmap = await createImageBitmap(blob);
    canvas.width = bitmap.width;
    canvas.height = bitmap.height;
    canvas.getContext("2d")?.drawImage(bitmap, 0, 0);
    bitmap.close();
    canvas.hidden = false;
    const text = headers.get("x-vertical-error-px");
    judge(verdict, text === null ? null : Number(text));
  } catch (error) {
    canvas.hidden = true;
    verdict.dataset.tone = "bad";
    setText(verdict, `No preview: ${error instanceof Error ? error.message : String(error)}`);
  }
}

/** @param {Calibration} c */
function understood(c) {
  /** @type {[string, string][]} */
  const facts = [
    ["Image size", `${c.width} × ${c.height} px`],
    ["Baseline", `${fixed(c.baseline_m, 4)} m`],
    ["Field of view", `${fixed(c.hfov_deg, 1)}° wide`],
    ["Images", c.rectified ? "rectified already" : "rectified by it"],
  ];
  return facts.map(([term, value]) => h("div", {}, h("dt", {}, term), h("dd", { class: "figure" }, value)));
}

/**
 * @param {HTMLElement} verdict
 * @param {number | null} px median vertical distance of matching points in the two images
 */
function judge(verdict, px) {
  if (px === null || !Number.isFinite(px)) {
    verdict.dataset.tone = "poor";
    return setText(verdict, "The vertical error could not be measured: too few matches between left and right.");
  }
  const tone = px < GOOD_PX ? "good" : px < POOR_PX ? "poor" : "bad";
  const words = {
    good: "the same point lies on the same line in both images",
    poor: "depth will be noisy; a better calibration is worth the while",
    bad: "this calibration does not fit these cameras",
  }[tone];
  verdict.dataset.tone = tone;
  setText(verdict, `Vertical error ${px.toFixed(2)} px: ${words}.`);
}
