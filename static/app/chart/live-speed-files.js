/** The live chart as files, made in the page: nothing of it need be kept by the server. */

/** @import { Curve } from "./speed-curves.js" */

const COLUMNS = "source,label,time_s,speed_mps,std_mps";
const LINE_PX = 18;
const MARGIN_PX = 10;

/**
 * @param {Iterable<Curve>} curves
 * @param {{begin: number, end: number, offset: number}} range of them; offset is to be added to the source's clock
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

/** @param {string} text */
function quoted(text) {
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/**
 * The drawing with the names of its curves below, on the page's ground.
 *
 * @param {HTMLCanvasElement} drawing
 * @param {{label: string, colour: string, dash: number[]}[]} entries colours as the canvas understands them
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
  entries.forEach(({ label, colour, dash }, line) => {
    const y = drawing.height + margin + (line + 0.5) * LINE_PX * scale;
    context.strokeStyle = colour;
    context.setLineDash(dash.map((px) => px * scale));
    context.beginPath();
    context.moveTo(2 * margin, y);
    context.lineTo(2 * margin + 18 * scale, y);
    context.stroke();
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
