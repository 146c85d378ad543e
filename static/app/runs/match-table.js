/** Table of the body matched to each track, corrected by a click. */

import { h, select, setAttribute, table, tint } from "../elements/dom.js";
import { fixed, trackColour } from "../elements/words.js";

/** @import { AlignmentFacts, ChartCurve } from "../contract" */

/** How a track was matched to its body. @type {Record<string, string>} */
const BY = { position: "position", speed: "speed", person: "manual choice" };
const NONE = "unmatched";
const MAX_BUTTONS = 5;

export class MatchTable extends HTMLElement {
  /** Called with a track and its body chosen by hand. @type {(key: string, body: string | null) => void} */
  corrected = () => {};

  /**
   * @param {AlignmentFacts | null} alignment
   * @param {ChartCurve[]} curves
   */
  show(alignment, curves) {
    const keys = Object.keys(alignment?.matches ?? {});
    if (!alignment || keys.length === 0) return this.replaceChildren();
    const bodies = Object.entries(alignment.roles).flatMap(([name, role]) =>
      role === "observer" ? [] : [name],
    );
    const { activeElement } = document;
    const focused = this.contains(activeElement)
      ? activeElement?.getAttribute("data-choice")
      : null;
    this.replaceChildren(
      table(
        "matches",
        ["Track", "Visible", "Body", "Matched by"],
        keys.map((key) => this.#row(key, alignment, bodies, curves)),
        "Body matched to each track. Choose another to correct it.",
      ),
    );
    if (focused)
      /** @type {HTMLElement | null} */ (
        this.querySelector(`[data-choice="${CSS.escape(focused)}"]`)
      )?.focus();
  }

  /** @param {boolean} busy then further corrections have to wait */
  setBusy(busy) {
    for (const choice of this.querySelectorAll("button, select"))
      setAttribute(choice, "aria-disabled", busy ? "true" : null);
  }

  /**
   * @param {string} key of the track, its segment first
   * @param {AlignmentFacts} alignment
   * @param {string[]} bodies
   * @param {ChartCurve[]} curves
   */
  #row(key, alignment, bodies, curves) {
    const [segment = 0, track = 0] = key.split(":").map(Number);
    const match = alignment.matches[key];
    const now = match?.body ?? null;
    const curve = curves.find(
      (each) => each.kind === "estimate" && each.segment === segment && each.track_id === track,
    );
    const first = curve?.times[0];
    const seen =
      curve && first !== undefined ? `${fixed(first, 1)}–${fixed(curve.times.at(-1), 1)} s` : "–";
    const name = segment > 0 ? `${track}, segment ${segment}` : String(track);
    const label = `Body of track ${name}`;
    const distance = match?.distance_m;
    const how = match
      ? `${BY[match.by] ?? match.by}${distance === null || distance === undefined ? "" : `, ${fixed(distance, 2)} m apart`}`
      : "–";
    return h(
      "tr",
      h("th", { scope: "row" }, tint(h("span.swatch"), trackColour(track)), name),
      h("td", seen),
      h(
        "td",
        bodies.length > MAX_BUTTONS
          ? this.#list(key, label, bodies, now)
          : this.#buttons(key, label, bodies, now),
      ),
      h("td", how),
    );
  }

  /**
   * @param {string} key
   * @param {string} label
   * @param {string[]} bodies
   * @param {string | null} now
   */
  #buttons(key, label, bodies, now) {
    const choices = [...bodies, null].map((body) => {
      const button = h(
        "button",
        { type: "button", "aria-pressed": String(body === now), "data-choice": `${key} ${body}` },
        body ?? NONE,
      );
      button.addEventListener("click", () => {
        if (body !== now) this.corrected(key, body);
      });
      return button;
    });
    return h("div.choices", { role: "group", "aria-label": label }, ...choices);
  }

  /**
   * @param {string} key
   * @param {string} label
   * @param {string[]} bodies more than fit side by side
   * @param {string | null} now
   */
  #list(key, label, bodies, now) {
    const choices = [["", NONE], ...bodies.map((body) => [body, body])];
    const list = select({ "aria-label": label, "data-choice": key }, choices);
    list.value = now ?? "";
    list.addEventListener("change", () => this.corrected(key, list.value || null));
    return list;
  }
}

customElements.define("observer-matches", MatchTable);
