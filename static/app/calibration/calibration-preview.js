/** Preview of a calibration before use: how it was read, and the newest pair rectified by it. */

import { details, h, paint, setText, table, tableRow } from "../elements/dom.js";
import { figureList } from "../elements/figure-list.js";
import { fixed, sentence } from "../elements/words.js";
import { requestImage } from "../shell/api.js";
import { showModal } from "../shell/modal.js";
import { verdictTable, viewChart } from "./report-parts.js";
import { TapeCheck } from "./tape-check.js";

/** @import { Calibration } from "./report-parts.js" */

const GOOD_PX = 0.5;
const POOR_PX = 1.5;

/**
 * Show the calibration in a dialog until it is closed.
 *
 * @param {Calibration} calibration
 * @param {boolean} active whether it is already in use
 * @returns {Promise<boolean>} whether to use it
 */
export async function confirmPreview(calibration, active) {
  const canvas = h("canvas", {
    width: 4,
    height: 1,
    role: "img",
    "aria-label": "Rectified pair, left and right, with horizontal lines across both",
  });
  const verdict = h("p.verdict", { role: "status" }, "Rectifying the newest pair…");
  const use = h(
    "button.button.primary",
    { value: "use", disabled: active },
    active ? "In use" : "Use this calibration",
  );
  const tape = new TapeCheck(calibration, canvas);
  const report = calibration.report;
  const closed = showModal(
    "preview",
    calibration.name,
    [
      calibration.origin && h("p", sentence(calibration.origin)),
      importNotes(calibration.notes),
      figureList(calibrationFigures(calibration)),
      report?.verdict && h("p.verdict", report.verdict.sentence),
      report &&
        details(
          "Quality",
          report.verdict ? verdictTable(report.verdict) : null,
          viewChart(report.views),
        ),
      canvas,
      h(
        "p.hint",
        "A point in the left image must lie on the same horizontal line in the right image.",
      ),
      verdict,
      tape.element,
      h("div.row", ...exportLinks(calibration)),
    ],
    h("button.button", { value: "close" }, "Close"),
    use,
  );
  const path = `/calibrations/${encodeURIComponent(calibration.id)}/preview`;
  void paintPreview(path, canvas, verdict, report).then((painted) => {
    if (painted) tape.begin();
  });
  return (await closed) === "use";
}

/** @param {Calibration} c @returns {string} its facts in one line */
export function describe(c) {
  return `${c.width} × ${c.height} · baseline ${fixed(c.baseline_m, 3)} m · field of view ${fixed(c.hfov_deg, 1)}°`;
}

/**
 * Draw a rectified pair and assess its row error.
 *
 * @param {string} path below /api
 * @param {HTMLCanvasElement} canvas
 * @param {HTMLElement} verdict
 * @param {Record<string, any> | null} report of the calibration, if there is one
 * @returns {Promise<boolean>} whether there was a pair to draw
 */
export async function paintPreview(path, canvas, verdict, report) {
  try {
    const { blob, headers } = await requestImage(path);
    paint(canvas, await createImageBitmap(blob));
    canvas.hidden = false;
    const text = headers.get("x-vertical-error-px");
    showVerdict(verdict, text === null ? null : Number(text), report?.held_out?.p95_px ?? null);
    return true;
  } catch (error) {
    canvas.hidden = true;
    verdict.dataset.tone = "bad";
    setText(verdict, `No preview: ${error instanceof Error ? error.message : String(error)}`);
    return false;
  }
}

/**
 * Compare two or more calibrations side by side in a dialog until it is closed.
 *
 * @param {Calibration[]} calibrations
 */
export function compareCalibrations(calibrations) {
  const now = new Map(calibrations.map((calibration) => [calibration, h("span", "…")]));
  /** @type {[string, (c: Calibration) => string | HTMLElement | undefined][]} */
  const rows = [
    ["Origin", (c) => c.origin ?? "uploaded"],
    ["Created", (c) => c.created_at.slice(0, 10)],
    ["Image size", (c) => `${c.width} × ${c.height} px`],
    ["Baseline", (c) => `${fixed(1000 * c.baseline_m, 1)} mm`],
    ["Field of view", (c) => `${fixed(c.hfov_deg, 1)}°`],
    ["Stereo error, RMS", (c) => (c.report ? `${fixed(c.report.rms_stereo_px, 2)} px` : "–")],
    [
      "Epipolar error, held-out views",
      (c) =>
        c.report?.held_out
          ? `${fixed(c.report.held_out.median_px, 2)} px, 95 % ≤ ${fixed(c.report.held_out.p95_px, 2)} px`
          : "–",
    ],
    ["Depth error at 3 m", depthAt3m],
    ["Epipolar error now", (c) => now.get(c)],
    [
      "Tape checks",
      (c) =>
        c.tape_checks
          .map((check) => `${fixed(check.measured_m, 2)} m: ${check.agrees ? "agrees" : "differs"}`)
          .join(", ") || "–",
    ],
  ];
  void showModal(
    "preview",
    "Compare calibrations",
    [
      table(
        "verdict-table",
        [null, ...calibrations.map(({ name }) => name)],
        rows.map(([term, value]) => tableRow(term, ...calibrations.map(value))),
      ),
      h("p.hint", "“Epipolar error now” is measured on the newest pair from the current source."),
    ],
    h("button.button", { value: "close" }, "Close"),
  );
  for (const [calibration, place] of now)
    void measuredRowOffset(calibration).then((text) => setText(place, text));
}

/** @param {Calibration} calibration */
async function measuredRowOffset(calibration) {
  try {
    const { headers } = await requestImage(
      `/calibrations/${encodeURIComponent(calibration.id)}/preview`,
    );
    const px = headers.get("x-vertical-error-px");
    return px === null ? "too few matches" : `${fixed(Number(px), 2)} px`;
  } catch {
    return "does not fit the current source";
  }
}

/** @param {Calibration} c */
function depthAt3m(c) {
  const row = c.report?.verdict?.rows.find(
    (/** @type {{distance_m: number}} */ each) => each.distance_m === 3,
  );
  return row ? `${fixed(100 * row.depth_m, 1)} cm` : "–";
}

/** @param {string[]} list */
function importNotes(list) {
  if (list.length === 0) return null;
  const opened = details(
    "What the import found",
    h("ul.plain-list", ...list.map((note) => h("li", sentence(note)))),
  );
  opened.open = true;
  return opened;
}

/** @param {Calibration} c */
function exportLinks(c) {
  const path = `/api/calibrations/${encodeURIComponent(c.id)}`;
  /** @type {[string, string][]} */
  const kinds = [
    ["opencv", "OpenCV"],
    ["ros", "ROS"],
    ["kalibr", "Kalibr"],
  ];
  return kinds.map(([kind, words]) =>
    h("a.button", { href: `${path}/export/${kind}`, download: "" }, `Download for ${words}`),
  );
}

/** @param {Calibration} c */
function calibrationFigures(c) {
  /** @type {import("../elements/figure-list.js").Figure[]} */
  const facts = [
    ["Image size", `${c.width} × ${c.height} px`],
    ["Baseline", `${fixed(c.baseline_m, 4)} m`],
    ["Field of view", `${fixed(c.hfov_deg, 1)}° horizontal`],
    ["Images", c.rectified ? "already rectified" : "rectified by this calibration"],
  ];
  if (c.devices.length) facts.push(["Cameras", c.devices.join(", ")]);
  return facts;
}

/**
 * @param {HTMLElement} verdict
 * @param {number | null} px median vertical distance between matching points in the two images
 * @param {number | null} heldOut 95th percentile of the corner error in the held-out views
 */
function showVerdict(verdict, px, heldOut) {
  if (px === null || !Number.isFinite(px)) {
    verdict.dataset.tone = "poor";
    return setText(verdict, "Epipolar error unknown: too few matches between left and right.");
  }
  if (px >= GOOD_PX && heldOut !== null && heldOut < GOOD_PX) {
    verdict.dataset.tone = "poor";
    return setText(
      verdict,
      `Epipolar error ${px.toFixed(1)} px in this pair, but ${heldOut.toFixed(2)} px in the board views. The repeated squares of a board can cause false matches: move the board out of view and load a new pair. If the error stays, a camera has moved.`,
    );
  }
  const tone = px < GOOD_PX ? "good" : px < POOR_PX ? "poor" : "bad";
  const words = {
    good: "matching points lie on the same line in both images",
    poor: "depth will be noisy; calibrate again for better results",
    bad: "this calibration does not fit these cameras",
  }[tone];
  verdict.dataset.tone = tone;
  setText(verdict, `Epipolar error ${px.toFixed(2)} px: ${words}.`);
}
