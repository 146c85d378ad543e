/** All obstacles of the newest observation, one line each. */

import { button, h, setAttribute, setText, tint } from "../elements/dom.js";
import { fillFigures } from "../elements/figure-list.js";
import { GLOSSARY } from "../elements/glossary.js";
import { LastSeen } from "../elements/last-seen.js";
import { Part } from "../elements/part.js";
import {
  bearingInWords,
  fixed,
  outOfViewInWords,
  sentence as asSentence,
  speedWithBand,
  STATE_WORDS,
  trackColour,
} from "../elements/words.js";

/** @import { ObstacleEntry } from "../contract" */
/** @import { Sighting } from "../elements/last-seen.js" */

/** @type {[name: string, help: string | null][]} */
const COLUMNS = [
  ["ID", GLOSSARY["track"]],
  ["Speed, m/s", `95 % interval: ${GLOSSARY["95 % interval"]}`],
  ["Ground truth", GLOSSARY["ground truth"]],
  ["Distance, m", null],
];

class ObstacleTable extends Part {
  #body = h("tbody");
  #empty = h("p.empty", "No moving obstacles.");
  #scroll = h("div.scroll-x", { tabindex: 0, role: "region", "aria-label": "Obstacles" });
  /** @type {Map<number, ReturnType<typeof makeRow>>} */
  #rows = new Map();
  #lastSeen = new LastSeen();

  build() {
    const head = h("tr", ...COLUMNS.map(([name, title]) => h("th", { scope: "col", title }, name)));
    this.#scroll.append(h("table", h("thead", head), this.#body));
    this.append(h("div.pane-head", h("h2", "Obstacles")), this.#scroll, this.#empty);
    this.listen("observation", () => this.#render());
    this.#render();
  }

  #render() {
    const message = this.hub.observation;
    const obstacles = message?.line.obstacles ?? [];
    if (message) this.#lastSeen.take(message.line);
    const present = new Set(obstacles.map((o) => o.id));
    for (const [id, row] of this.#rows) {
      if (!present.has(id)) {
        row.forEach((line) => line.remove());
        this.#rows.delete(id);
      }
    }
    for (const obstacle of obstacles) {
      let row = this.#rows.get(obstacle.id);
      if (!row) {
        row = makeRow(obstacle.id, () => this.#render());
        this.#rows.set(obstacle.id, row);
        this.#body.append(...row);
      }
      const body = message?.truth.find((b) => b.track_id === obstacle.id);
      fillRow(row, obstacle, body?.speed ?? null, this.#lastSeen.of(obstacle.id));
    }
    this.#empty.hidden = obstacles.length > 0;
    this.#scroll.hidden = obstacles.length === 0;
  }
}

/**
 * Make two rows: the figures, and why the obstacle counts as dynamic. A click on either, or on the
 * button with the number, shows the figures behind the reason.
 *
 * @param {number} id
 * @param {() => void} opened
 * @returns {[HTMLTableRowElement, HTMLTableRowElement]}
 */
function makeRow(id, opened) {
  const swatch = tint(h("span.swatch", { "aria-hidden": "true" }), trackColour(id));
  const cells = COLUMNS.slice(1).map(() => h("td"));
  const more = button([swatch, String(id)], null, {
    class: "row-button",
    "aria-expanded": "false",
    title: "Show why it counts as moving",
  });
  const figures = h("tr", h("th", { scope: "row" }, more), ...cells);
  const behind = h("dl.figures", { hidden: true });
  const why = h("tr.why", h("td", { colspan: COLUMNS.length }, h("p"), behind));
  const toggle = () => {
    behind.hidden = !behind.hidden;
    more.setAttribute("aria-expanded", String(!behind.hidden));
    opened();
  };
  const close = (/** @type {KeyboardEvent} */ event) => {
    if (event.key !== "Escape" || behind.hidden) return;
    event.preventDefault();
    toggle();
  };
  for (const row of [figures, why]) {
    row.addEventListener("click", toggle);
    row.addEventListener("keydown", close);
  }
  return [figures, why];
}

/**
 * @param {[HTMLTableRowElement, HTMLTableRowElement]} rows
 * @param {ObstacleEntry} obstacle
 * @param {number | null} truth m/s
 * @param {Sighting | null} sighting
 */
function fillRow([figures, why], obstacle, truth, sighting) {
  const texts = [speedWithBand(obstacle), fixed(truth, 2), fixed(obstacle.range, 2)];
  texts.forEach((text, index) => {
    const cell = figures.cells[index + 1];
    if (cell) setText(cell, text);
  });
  setAttribute(figures, "data-state", obstacle.state);
  const [sentence, behind] = why.cells[0]?.children ?? [];
  if (sentence) {
    setText(sentence, whyInWords(obstacle, sighting));
    setAttribute(sentence, "title", meaningOf(obstacle));
  }
  if (behind instanceof HTMLDListElement && !behind.hidden)
    fillFigures(behind, figuresBehind(obstacle));
}

/**
 * @param {ObstacleEntry} obstacle
 * @param {Sighting | null} sighting
 */
function whyInWords({ state, motion, bearing, why }, sighting) {
  if (state === "coasting") return outOfViewInWords(sighting);
  const where = asSentence(`${STATE_WORDS[motion]}, ${bearingInWords(bearing)}`);
  return why ? `${where} ${asSentence(why)}` : where;
}

/** The meaning of the state at the start of a row, if it is a term. @param {ObstacleEntry} obstacle */
function meaningOf({ state, motion }) {
  if (state === "coasting") return GLOSSARY["coasting"];
  return motion === "in_place" ? GLOSSARY["in place"] : null;
}

/** @param {ObstacleEntry} obstacle @returns {import("../elements/figure-list.js").Figure[]} */
function figuresBehind({ points, significance, closing_speed, size, state }) {
  return [
    ["Significance", `${fixed(significance, 1)} σ`, GLOSSARY["significance"]],
    ["Moving points", String(points)],
    ["Closing speed", closing_speed === null ? "unknown" : `${fixed(closing_speed, 2)} m/s`],
    ["Visible size", `${size.map((m) => fixed(m, 2)).join(" × ")} m`],
    ["State", state],
  ];
}

customElements.define("observer-obstacles", ObstacleTable);
