/** Why the observer drives as it does on its way to a goal: what decides, and rejected paths. */

import { fillList, h, setText } from "./dom.js";
import { fillFigures } from "./figure-list.js";
import { figuresOfGoal, refusalsInWords } from "./goal-explanation-words.js";

/** @import { GoalNow } from "../contract" */

/** Details behind the one sentence that is always shown for a goal. */
export class GoalExplanation extends HTMLElement {
  #figures = h("dl.figures");
  #title = h("p.hint");
  #refused = h("ul.refused-paths");

  connectedCallback() {
    if (!this.childElementCount) this.append(this.#figures, this.#title, this.#refused);
  }

  /** @param {GoalNow} goal */
  show(goal) {
    fillFigures(this.#figures, figuresOfGoal(goal));
    setText(this.#title, goal.refused.length > 0 ? "Rejected paths" : "No path was rejected.");
    fillList(this.#refused, refusalsInWords(goal));
  }
}

customElements.define("observer-goal-explanation", GoalExplanation);
