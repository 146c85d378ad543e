/**
 * The headline: who moves, how fast, plus or minus what, against ground truth, in words. While
 * the data are stale, it says so instead, in every view; nothing else does in words.
 */

import { h, setAttribute, setText, tint } from "../elements/dom.js";
import { GLOSSARY } from "../elements/glossary.js";
import { LastSeen } from "../elements/last-seen.js";
import { Part } from "../elements/part.js";
import { headline, trackColour } from "../elements/words.js";
import { paceWarning } from "./pace-words.js";

// Faster changes cannot be read; spoken words change more slowly still.
const SHOWN_EVERY_MS = 250;
const SPOKEN_EVERY_MS = 5000;

class Headline extends Part {
  #shownAt = 0;
  #spokenAt = 0;
  #tone = "";
  #lastSeen = new LastSeen();
  #text = h("p.headline-text", { title: `95 % interval: ${GLOSSARY["95 % interval"]}` });
  // The words change several times a second; this copy for screen readers changes less often.
  #spoken = h("p.visually-hidden", { role: "status", "aria-live": "polite" });
  #context = h("p.headline-context");

  build() {
    this.append(this.#text, this.#context, this.#spoken);
    this.listen("observation", () => {
      if (this.hub.observation) this.#lastSeen.take(this.hub.observation.line);
      this.#render(false);
    });
    this.listen("freshness", () => this.#render(true));
    this.listen("status", () => this.#renderContext());
    this.#render(true);
    // While the data are stale, only their age changes.
    setInterval(() => {
      if (this.hub.freshness.state === "stale") this.#render(false);
    }, SHOWN_EVERY_MS);
  }

  /** @param {boolean} atOnce */
  #render(atOnce) {
    setAttribute(document.documentElement, "data-freshness", this.hub.freshness.state);
    const now = performance.now();
    const { text, id, tone } = this.#words();
    if (!atOnce && tone === this.#tone && now - this.#shownAt < SHOWN_EVERY_MS) return;
    this.#shownAt = now;
    setText(this.#text, text);
    setAttribute(this, "data-tone", tone);
    tint(this, id === null ? null : trackColour(id));
    if (tone !== this.#tone || now - this.#spokenAt > SPOKEN_EVERY_MS) {
      this.#spokenAt = now;
      setText(this.#spoken, text);
    }
    this.#tone = tone;
  }

  /** @returns {{text: string, id: number | null, tone: string}} */
  #words() {
    const { freshness, observation } = this.hub;
    if (freshness.state === "stale") {
      const age = Math.round(freshness.age_s);
      const old = age > 0 ? ` The view is ${age} s old.` : "";
      return { text: `Stale: ${freshness.reason}${old}`, id: null, tone: "stale" };
    }
    if (freshness.state === "none") return { text: freshness.reason, id: null, tone: "calm" };
    if (!observation) return { text: freshness.reason, id: null, tone: "calm" };
    return headline(observation.line, observation.truth, this.#lastSeen);
  }

  #renderContext() {
    const { status } = this.hub;
    if (!status) return;
    const { source, run, calibration } = status;
    const calibrating = status.engine.state === "calibrating";
    const { freshness } = this.hub;
    const held = freshness.reason.replace(/\.$/, "");
    // What needs attention comes first: a narrow window cuts off the end.
    const words = source
      ? [
          source.name,
          freshness.state === "held" ? held.charAt(0).toLowerCase() + held.slice(1) : null,
          paceWarning(status),
          run ? `run ${run.name}` : calibrating ? "observation paused" : "preview, not recorded",
          calibration && !calibrating ? `calibration ${calibration.name}` : null,
          calibrating ? null : status.has_truth ? "with ground truth" : "no ground truth",
          `${source.width} × ${source.height} at ${Number(source.frame_rate.toFixed(1))} fps`,
        ]
      : [
          status.engine.reason
            ? "No source is open yet"
            : "No source is open. Choose one under Source.",
        ];
    const context = words.filter(Boolean).join(" · ");
    setText(this.#context, context);
    setAttribute(this.#context, "title", context);
  }
}

customElements.define("observer-headline", Headline);
