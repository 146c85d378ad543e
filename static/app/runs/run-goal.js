/** What the observer did on its way to a goal at the frame shown, and why. */

import { details, h, setText } from "../elements/dom.js";
import { GoalExplanation } from "../elements/goal-explanation.js";
import { fixed } from "../elements/words.js";

/** @import { FrameEntry } from "../contract" */

export class RunGoal extends HTMLElement {
  #sentence = h("p");
  #why = new GoalExplanation();
  // It scrolls, so that a chart below does not move under the pointer.
  #opens = details("Why", h("div", { tabindex: 0, role: "group", "aria-label": "Why" }, this.#why));

  connectedCallback() {
    if (this.childElementCount) return;
    this.#opens.open = true;
    this.append(h("h3", "On the way to a goal"), this.#sentence, this.#opens);
  }

  /**
   * @param {FrameEntry | null} entry null: no frame is shown
   * @param {boolean} had whether the run had a goal at any time
   */
  show(entry, had) {
    this.hidden = !had || !entry;
    if (!had || !entry) return;
    const { goal, plan } = entry;
    const text = goal?.sentence ?? "no goal.";
    setText(this.#sentence, `${fixed(plan.time, 2)} s: ${text}`);
    this.#why.hidden = goal?.state !== "driving";
    if (goal) this.#why.show(goal);
  }
}

customElements.define("observer-run-goal", RunGoal);
