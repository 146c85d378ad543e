/** The guided check: what to do at each step, what was measured, and the records of past checks. */

import {
  button,
  details,
  downloadLink,
  field,
  h,
  input,
  item,
  onSubmit,
  setAttribute,
  setText,
  stateChip,
} from "../elements/dom.js";
import { KeyedList, moveFocus } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { fixed, sentence, when } from "../elements/words.js";
import { request } from "../shell/api.js";
import { askConfirmation, exclusiveRunner } from "../shell/notice.js";
import { stopInWords } from "./robot-words.js";
import { ROLE_WORDS } from "./roles.js";

/** @import { CheckEntry, CheckStep } from "../contract" */

/** @type {Record<string, string>} */
const STATES = {
  waiting: "To do",
  driving: "Driving",
  passed: "Passed",
  failed: "Failed",
  skipped: "Skipped",
  incomplete: "Steps skipped",
  given_up: "Aborted",
};

class GuardCheck extends Part {
  #what = h(
    "p.hint",
    "Drive by hand and follow each step: somebody walks into the path, covers a lens, unplugs a camera, or you close the browser. The server saves a dated record of how soon the robot was commanded to stop, how soon it came to a standstill, and how far it rolled.",
  );
  #advice = h("p.check-advice");
  #note = input("text", "check-note", { maxlength: "500" });
  #start = h("button.button.primary", { type: "submit" }, "Start check");
  #form = h("form.stack", field("Note", this.#note), h("div.row", this.#start));
  #title = h("p.figure");
  #instruction = h("p.check-instruction", { role: "status" });
  #stepResult = h("p.check-result", { role: "status" });
  #skip = button("Skip step", () =>
    this.#do(() => request("POST", "/robots/check/skip", { name: this.#operatorName })),
  );
  #abort = button("Abort check", () => this.#do(() => this.#askToAbort()));
  #currentStep = h(
    "div.check-now",
    { hidden: true },
    this.#title,
    this.#instruction,
    this.#stepResult,
    h("div.row", this.#skip, this.#abort),
  );
  #refusal = h("p.field-error", { role: "alert" });
  #outcome = h("p", { role: "status" });
  #trouble = h("p.robot-trouble", { role: "alert", hidden: true });
  #save = button("Save record", () => this.#do(() => this.#end()), { hidden: true });
  #stepList = h("ul.item-list.check-steps", { "aria-label": "Check steps" });
  #steps = new KeyedList(this.#stepList, (/** @type {CheckStep} */ step) => stepItem(step));
  #recordList = h("ul.item-list.check-records", { "aria-label": "Check records" });
  #records = new KeyedList(this.#recordList, (/** @type {CheckEntry} */ entry) =>
    recordItem(entry),
  );
  #none = h("p.empty", { hidden: true }, "No saved checks.");
  #earlier = h("div", h("h4", "Previous checks"), this.#none, this.#recordList);
  #details = details(
    "Guard check",
    this.#what,
    this.#advice,
    this.#form,
    this.#currentStep,
    this.#refusal,
    this.#outcome,
    this.#trouble,
    this.#save,
    this.#stepList,
    this.#earlier,
  );
  #do = exclusiveRunner((busy) => {
    if (busy) return;
    this.#loaded = "";
    this.#render();
  }, this.#refusal);
  /** Role and record last loaded; if they change, load again. */
  #loaded = "";

  build() {
    this.append(this.#details);
    onSubmit(this.#form, () => this.#do(() => this.#begin()));
    this.#details.addEventListener("toggle", () => this.#render());
    this.listen("robots", () => this.#render());
    this.listen("change", () => this.#render(), this.hub.driver);
    this.whenShown(() => this.#render());
    this.listen("reconnected", () => {
      this.#loaded = "";
    });
    this.#render();
  }

  /** This operator's name as others see it; null if none was given. */
  get #operatorName() {
    return this.hub.driver.link.name || null;
  }

  async #begin() {
    await request("POST", "/robots/check", {
      role: this.hub.driver.role,
      note: this.#note.value.trim() || null,
      name: this.#operatorName,
    });
    this.#note.value = "";
  }

  async #askToAbort() {
    if (
      await askConfirmation(
        "Abort the guard check?",
        "The record keeps what was measured so far and is marked as aborted.",
        "Abort check",
      )
    )
      await this.#end();
  }

  async #end() {
    const name = this.#operatorName;
    await request("DELETE", `/robots/check${name ? `?name=${encodeURIComponent(name)}` : ""}`);
  }

  /** @param {string} wanted */
  async #load(wanted) {
    const { role } = this.hub.driver;
    try {
      const [{ advice }, records] = await Promise.all([
        /** @type {Promise<{advice: string | null}>} */ (
          request("GET", `/robots/check?role=${role}`)
        ),
        /** @type {Promise<CheckEntry[]>} */ (request("GET", "/robots/checks")),
      ]);
      // Another role was chosen meanwhile.
      if (wanted !== this.#loaded) return;
      setText(this.#advice, advice ?? "");
      this.#records.show(records, ({ name }) => name);
      this.#none.hidden = records.length > 0;
    } catch {
      // The next message of the server asks again.
      if (wanted === this.#loaded) this.#loaded = "";
    }
  }

  #render() {
    if (this.offsetParent === null) return;
    const { robots, driver } = this.hub;
    const check = robots?.check ?? null;
    const going = check !== null && check.ended_at === null;
    // A page that comes back in the middle of a check shows where it is.
    if (going && !this.#details.open && !this.#loaded) this.#details.open = true;
    const wanted = `${driver.role} ${check?.record ?? ""}`;
    if (robots && wanted !== this.#loaded) {
      this.#loaded = wanted;
      void this.#load(wanted);
    }
    const step = going && check.present !== null ? (check.steps[check.present] ?? null) : null;
    // Show the instruction above the controls.
    setAttribute(this, "data-going", going ? "" : null);
    if (step) {
      this.#currentStep.hidden = false;
      moveFocus(this.#form, this.#skip);
    }
    for (const part of [this.#what, this.#advice, this.#form, this.#earlier]) part.hidden = going;
    this.#start.disabled = !driver.robot() || (check !== null && !going && !check.record);
    this.#start.title = driver.robot() ? "" : `No ${driver.role} robot is connected`;
    if (!step) {
      moveFocus(this.#currentStep, this.#start, this.#details.querySelector("summary"));
      this.#currentStep.hidden = true;
    }
    if (step && check) {
      setText(
        this.#title,
        `${ROLE_WORDS[check.role]}, step ${(check.present ?? 0) + 1} of ${check.steps.length}: ${step.title}${step.state === "driving" ? " (driving)" : ""}`,
      );
      setText(this.#instruction, step.instruction);
      setText(this.#stepResult, step.told ? sentence(step.told) : "");
    }
    const outcome = check?.outcome;
    setText(
      this.#outcome,
      outcome ? `Check result: ${(STATES[outcome] ?? outcome).toLowerCase()}.` : "",
    );
    setText(this.#trouble, sentence(check?.trouble ?? ""));
    this.#trouble.hidden = !check?.trouble;
    this.#save.hidden = !check?.trouble;
    this.#steps.show(check?.steps ?? [], ({ name }) => name);
  }
}

/** @param {string} state */
function chip(state) {
  // A step still to do needs no warning colour.
  return stateChip(state === "waiting" ? "none" : state, STATES[state] ?? state);
}

/** @param {CheckStep} step */
function stepItem({ title, state, figures, verdict, sentence: why, skipped_by }) {
  const words = figures ? `From ${fixed(figures.speed_mps, 2)} m/s: ${stopInWords(figures)}.` : "";
  return item([
    h("p", h("b", title), " ", chip(state)),
    words && h("p.figure", words),
    verdict && h("p.hint", sentence(verdict)),
    why && h("p.hint", sentence(why)),
    skipped_by && h("p.hint", `Skipped by ${skipped_by}`),
  ]);
}

/** @param {CheckEntry} entry */
function recordItem({ name, role, started_at, outcome, note }) {
  const path = `/api/robots/checks/${encodeURIComponent(name)}`;
  const at = when(started_at);
  return item(
    [
      h("p", h("b", at), " ", chip(outcome)),
      h("p.hint", [ROLE_WORDS[role], note].filter(Boolean).join(" · ")),
    ],
    downloadLink("Text", {
      href: `${path}?format=markdown`,
      download: `${name}.md`,
      "aria-label": `Check of ${at} as text`,
    }),
    downloadLink("JSON", {
      href: path,
      download: `${name}.json`,
      "aria-label": `Check of ${at} as JSON`,
    }),
  );
}

customElements.define("observer-guard-check", GuardCheck);
