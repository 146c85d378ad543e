/** The live chart as files, made in the page, so the server need not keep anything. */

/** @import { Curve } from "./speed-curves.js" */

const COLUMNS = "source,label,time_s,speed_mps,std_mps";
const LINE_PX = 18;
const MARGIN_PX = 10;
const SWATCH_PX = 18;

/**
 * @param {Iterable<Curve>} curves
 * @param {{begin: number, end: number, offset: number}} range of them; offset: curve time minus source time
 * @returns {Blob}
 */
export function speedsAsCsv(curves, { begin, end, offset }) {
  const rows = [...curves].flatMap(({ kind, label, times, speeds, stds }) =>
    times.flatMap((time, i) => {
      const speed = speeds[i];
      if (typeof speed !== "number" || time < begin || time > end) return [];
      return [
        [
          kind,
          quoted(label),
          (time - offset).toFixed(4),
          speed.toFixed(5),
          stds[i]?.toFixed(5) ?? "",
        ].join(","),
      ];
    }),
  );
  return new Blob([[COLUMNS, ...rows, ""].join("\n")], { type: "text/csv" });
}

/**
 * Draw the swatch before a name like those of the page, see run-chart.css.
 *
 * @param {CanvasRenderingContext2D} context
 * @param {string} kind of a curve or a mark
 * @param {number} x of its left end
 * @param {number} y of its middle
 * @param {number} scale
 */
function drawSwatch(context, kind, x, y, scale) {
  const width = SWATCH_PX * scale;
  context.beginPath();
  if (kind === "band") {
    context.globalAlpha = 0.22;
    context.fillRect(x, y - 5 * scale, width, 10 * scale);
    context.globalAlpha = 1;
  } else if (kind === "gap") {
    context.fillRect(x, y - 2 * scale, width, 4 * scale);
  } else if (kind === "start") {
    context.arc(x + width / 2, y, 3 * scale, 0, 2 * Math.PI);
    context.fill();
  } else if (kind === "change") {
    context.setLineDash([3 * scale, 3 * scale]);
    context.moveTo(x + width / 2, y - 7 * scale);
    context.lineTo(x + width / 2, y + 7 * scale);
    context.stroke();
  } else {
    context.moveTo(x, y);
    context.lineTo(x + width, y);
    context.stroke();
  }
}

/** @param {string} text */
function quoted(text) {
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/**
 * Return the drawing with its legend below, on the page's background.
 *
 * @param {HTMLCanvasElement} drawing
 * @param {{kind: string, label: string, colour: string, dash: number[]}[]} entries colours as the canvas understands them
 * @param {{ground: string, text: string}} colours
 * @returns {Promise<Blob>}
 */
export function asPicture(drawing, entries, { ground, text }) {
  const scale = drawing.width / (drawing.clientWidth || drawing.width);
  const margin = MARGIN_PX * scale;
  const canvas = document.createElement("canvas");
  canvas.width = drawing.width + 2 * margin;
  canvas.height = drawing.height + 2 * margin + entries.length * LINE_PX * scale;
  const context = canvas.getContext("2d");
  if (!context) throw new Error("This browser cannot draw the image. Export CSV instead.");
  context.fillStyle = ground;
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(drawing, margin, margin);
  context.font = `${12 * scale}px sans-serif`;
  context.textBaseline = "middle";
  context.lineWidth = 2 * scale;
  entries.forEach(({ kind, label, colour, dash }, line) => {
    const y = drawing.height + margin + (line + 0.5) * LINE_PX * scale;
    context.strokeStyle = colour;
    context.fillStyle = colour;
    context.setLineDash(dash.map((px) => px * scale));
    drawSwatch(context, kind, 2 * margin, y, scale);
    context.fillStyle = text;
    context.fillText(label, 2 * margin + 26 * scale, y);
  });
  return new Promise((resolve, reject) => {
    canvas.toBlob(
      (blob) =>
        blob ? resolve(blob) : reject(new Error("Could not create the image. Export CSV instead.")),
      "image/png",
    );
  });
}
