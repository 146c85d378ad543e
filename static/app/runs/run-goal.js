/** What the observer did on its way to a goal at the frame of a run that is shown, and why. */

import { h, setText } from "../elements/dom.js";
import { GoalWhy } from "../elements/goal-why.js";
import { fixed } from "../elements/words.js";

/** @import { FrameEntry } from "../contract" */

export class RunGoal extends HTMLElement {
  #title = h("h3");
  #sentence = h("p.goal-sentence");
  #why = new GoalWhy();

  connectedCallback() {
    if (!this.childElementCount) this.append(this.#title, this.#sentence, this.#why);
  }

  /**
   * @param {FrameEntry | null} entry null: no frame is shown
   * @param {boolean} had whether the run had a goal at some time
   */
  show(entry, had) {
    this.hidden = !had || !entry;
    if (!had || !entry) return;
    const { goal, plan } = entry;
    setText(this.#title, `On the way to a goal, at ${fixed(plan.time, 2)} s`);
    setText(this.#sentence, goal?.sentence ?? "No goal at this time.");
    this.#why.hidden = goal?.state !== "driving";
    if (goal) this.#why.show(goal);
  }
}

customElements.define("observer-run-goal", RunGoal);
