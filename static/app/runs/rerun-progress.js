/** Progress of a re-run, its cancellation and its outcome. */

import { button, h, setText } from "../elements/dom.js";
import { moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { sentence } from "../elements/words.js";
import { request } from "../shell/api.js";
import { attemptIn } from "../shell/notice.js";

/** @import { RerunStatus, Run } from "../contract" */
/** @typedef {Pick<Run, "id" | "name">} Watched */

/** @type {Record<RerunStatus["state"], string>} */
const STATES = {
  waiting: "Waiting for another re-run",
  observing: "Processing the recording",
  held: "Paused while a robot is armed",
  finishing: "Saving the results",
};

export class RerunProgress extends Part {
  /** Called with the run once it has ended; null if nothing is left. @type {(run: Run | null) => void} */
  ended = () => {};

  #bar = h("progress", { max: 1, value: 0, "aria-label": "Progress of the re-run" });
  #words = h("span", { role: "status" });
  #cancel = button("Cancel", () => this.#end());
  #going = h("div.rerun-progress", this.#bar, this.#words, this.#cancel);
  #error = h("p.field-error", { role: "alert" });
  /** The re-run being watched. @type {Watched | null} */
  #run = null;
  /** Whether it has appeared in the status, which may be older than the re-run. */
  #seen = false;
  #began = 0;
  /** Whether it is being cancelled. */
  #leaving = false;

  build() {
    this.append(this.#going, this.#error);
    this.listen("status", () => this.#render());
    this.#going.hidden = true;
  }

  /** @param {Watched | null} run a re-run in progress; null watches none */
  watch(run) {
    if (run?.id === this.#run?.id) return;
    this.#run = run;
    this.#seen = false;
    this.#began = performance.now();
    setText(this.#error, "");
    this.#render();
  }

  #render() {
    const run = this.#run;
    if (!run) {
      moveFocus(this.#going, this.closest("section, observer-pages")?.querySelector("h2"));
      this.#going.hidden = true;
      return;
    }
    this.#going.hidden = false;
    const now = this.hub.status?.reruns.find(({ id }) => id === run.id);
    this.#seen ||= now !== undefined;
    if (this.#leaving) return;
    if (now) {
      this.#bar.value = now.share;
      // In steps of 10 %, so that screen readers do not announce it all the time.
      const done = now.state === "observing" ? `, ${Math.floor(now.share * 10) * 10} % done` : "";
      setText(this.#words, `${run.name}: ${STATES[now.state].toLowerCase()}${done}`);
    } else if (this.#seen || performance.now() - this.#began > 1500) {
      void this.#finish(run);
    }
  }

  /** @param {Watched} run */
  async #finish(run) {
    this.watch(null);
    /** @type {Run | null} */
    const ended = await request("GET", `/runs/${encodeURIComponent(run.id)}`).catch(() => null);
    this.hub.emit("runs");
    if (ended?.state === "failed")
      setText(this.#error, `Re-run failed: ${sentence(ended.reason ?? "the reason is not known")}`);
    this.ended(ended);
  }

  async #end() {
    const run = this.#run;
    if (!run) return;
    this.#leaving = true;
    await attemptIn(this.#error, async () => {
      await request("DELETE", `/runs/${encodeURIComponent(run.id)}`);
      this.watch(null);
      this.hub.emit("runs");
      this.ended(null);
    });
    this.#leaving = false;
  }
}

customElements.define("observer-rerun-progress", RerunProgress);
