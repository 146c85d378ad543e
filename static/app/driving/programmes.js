/** Programmes: timed velocities, played while their operator stays present. */

import {
  button,
  details,
  field,
  h,
  icon,
  iconButton,
  input,
  item,
  onSubmit,
  setText,
} from "../elements/dom.js";
import { KeyedList } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { durationInWords } from "../elements/words.js";
import { ApiError, request } from "../shell/api.js";
import { attemptIn, askConfirmation, notify, exclusiveRunner } from "../shell/notice.js";
import { clock, firstSteps, incidentInWords } from "./robot-words.js";
import { isArmed, ROLE_WORDS } from "./roles.js";

/** @import { ProgrammeEntry, ProgrammeNow } from "../contract" */

class Programmes extends Part {
  /** @type {ProgrammeEntry[]} */
  #programmes = [];
  #list = h("ul.item-list");
  #items = new KeyedList(this.#list, (/** @type {ProgrammeEntry} */ entry) => this.#item(entry));
  #empty = h("p.empty", { hidden: true }, "No programmes found.");
  #repeat = input("number", "programme-repeat", { min: "1", max: "100", step: "1", value: "1" });
  #reverse = input("checkbox", "programme-reverse");
  #running = h("div.programme-running", { hidden: true });
  #words = h("p.figure");
  #progress = h("progress", { max: "1", value: "0", "aria-label": "Programme progress" });
  #stop = button([icon("stop"), "Stop programme"], () =>
    this.#do(() => request("DELETE", "/robots/programme")),
  );
  #text = h("textarea", {
    id: "programme-text",
    rows: "8",
    spellcheck: "false",
    "aria-describedby": "programme-error",
  });
  #file = input("file", "programme-file", { accept: ".yaml,.yml,text/yaml" });
  #error = h("p.field-error", { id: "programme-error", role: "alert" });
  #own = details("Custom programme");
  /** Why a programme ended early; empty if none did. */
  #ended = h("p.programme-ended", { role: "status", hidden: true });
  #wasRunning = false;
  /** Time of the last early end when the newest programme began. */
  #endedBefore = "";
  #refusal = h("p.field-error", { role: "alert" });
  #do = exclusiveRunner(undefined, this.#refusal);
  #loaded = false;

  build() {
    const form = h(
      "form.stack",
      { novalidate: true },
      field("Load from file", this.#file),
      field(
        "YAML",
        this.#text,
        "A name, a title, and steps for each role with seconds, speed_mps and turn_rate_radps. To start from an existing programme, press its “Copy” button.",
      ),
      this.#error,
      h("div.row", h("button.button.primary", { type: "submit" }, "Save programme")),
    );
    this.#own.append(form);
    this.#running.append(this.#words, this.#progress, this.#stop);
    this.append(
      h("h3", "Programmes"),
      h(
        "p.hint",
        "A programme runs only while this page is open and visible and you have armed every robot in it.",
      ),
      this.#running,
      this.#ended,
      h(
        "div.row",
        h("label", { for: "programme-repeat" }, "Repeat"),
        this.#repeat,
        h("label.check", { for: "programme-reverse" }, this.#reverse, "Both directions"),
      ),
      this.#refusal,
      this.#empty,
      this.#list,
      this.#own,
    );
    this.#file.addEventListener("change", () => void this.#readFile());
    onSubmit(form, () => this.#save());
    this.listen("robots", () => {
      this.#renderEnd();
      this.#render();
    });
    this.listen("change", () => this.#render(), this.hub.driver);
    this.whenShown(() => this.#render());
    this.listen("reconnected", () => {
      this.#loaded = false;
    });
    this.#render();
  }

  async #load() {
    /** @type {ProgrammeEntry[] | null} */
    const programmes = await request("GET", "/programmes").catch(() => null);
    if (!programmes) {
      // The next message of the server asks again.
      this.#loaded = false;
      return;
    }
    this.#programmes = programmes;
    this.#empty.hidden = programmes.length > 0;
    this.#render();
  }

  /** Show why a programme ended early until the next one begins. */
  #renderEnd() {
    const { robots } = this.hub;
    const newest = robots?.incidents?.findLast(({ kind }) => kind === "programme");
    const isRunning = Boolean(robots?.programme);
    if (isRunning && !this.#wasRunning) this.#endedBefore = newest?.at ?? "";
    this.#wasRunning = isRunning;
    const endedEarly = !isRunning && newest && newest.at !== this.#endedBefore;
    setText(this.#ended, endedEarly ? incidentInWords(newest) : "");
    this.#ended.hidden = !endedEarly;
  }

  /** @param {ProgrammeNow} running */
  #title({ name }) {
    return this.#programmes.find((entry) => entry.name === name)?.title ?? name;
  }

  /** @param {ProgrammeNow} running @returns {string} as in "0:05 of 0:14, round 2 of 3" */
  #place({ elapsed_s, duration_s, phase, round, repeat }) {
    const at =
      phase === "gesture" ? "opening gesture" : `${clock(elapsed_s)} of ${clock(duration_s)}`;
    return `${at}${repeat > 1 ? `, round ${round} of ${repeat}` : ""}`;
  }

  #render() {
    if (this.offsetParent === null) return;
    const { robots } = this.hub;
    if (!this.#loaded && robots) {
      this.#loaded = true;
      void this.#load();
    }
    const running = robots?.programme ?? null;
    this.#running.hidden = !running;
    if (running) {
      setText(this.#words, `${this.#title(running)}: ${this.#place(running)}`);
      this.#progress.value =
        running.duration_s > 0 ? Math.min(1, running.elapsed_s / running.duration_s) : 0;
    }
    this.#items.show(this.#programmes, ({ name }) => name);
    for (const entry of this.#programmes) {
      const item = this.#list.querySelector(`[data-programme="${CSS.escape(entry.name)}"]`);
      const start = item?.querySelector("button.start");
      const hint = item?.querySelector(".missing");
      const missing = running ? "" : this.#missing(entry);
      if (start instanceof HTMLButtonElement) start.disabled = Boolean(missing) || running !== null;
      if (hint) setText(hint, missing);
    }
  }

  /** Say what must be done before it can be started. @param {ProgrammeEntry} entry */
  #missing({ roles }) {
    const { driver, robots } = this.hub;
    if (robots?.stopped) return "All robots are stopped: reset the stop first.";
    if (roles.includes("observer") && robots?.goal?.state === "driving")
      return "The observer is driving to a goal: cancel it first.";
    return firstSteps(
      roles.flatMap((role) => {
        const robot = driver.robot(role);
        if (!robot) return [["connect", role]];
        const ours = driver.link.leases.has(role);
        if (robot.operator && !ours) return [["take control of", role]];
        return ours && isArmed(robot) ? [] : [["arm", role]];
      }),
    );
  }

  /** @param {ProgrammeEntry} entry */
  #item(entry) {
    const { name, title, help, roles, duration_s, own } = entry;
    const start = button([icon("play"), "Start"], () => this.#do(() => this.#begin(entry)), {
      class: "button start",
      "aria-label": `Start ${title}`,
    });
    const copy = button("Copy", () => this.#do(() => this.#copy(name)), {
      "aria-label": `Copy ${title}`,
      title: "Copy the text into the field below",
    });
    const who = roles.map((role) => ROLE_WORDS[role]).join(" and ");
    const element = item(
      [
        h("p", h("b", title)),
        h("p.hint.figure", `${who} · ${durationInWords(duration_s)}`),
        help && h("p.hint", help),
        h("p.missing"),
      ],
      start,
      copy,
      own && iconButton("trash", `Delete ${title}`, () => this.#remove(entry), { title: "Delete" }),
    );
    element.className = "programme";
    element.dataset.programme = name;
    return element;
  }

  /** @param {ProgrammeEntry} entry */
  async #begin({ name, title, roles }) {
    const { leases } = this.hub.driver.link;
    const repeat = Number(this.#repeat.value);
    if (!Number.isInteger(repeat) || repeat < 1)
      throw new ApiError("Repeat must be a whole number, 1 or more.", 422);
    await request("POST", "/robots/programme", {
      name,
      repeat,
      reverse: this.#reverse.checked,
      leases: Object.fromEntries(roles.map((role) => [role, leases.get(role)])),
    });
    notify(`${title} started.`);
  }

  /** @param {string} name */
  async #copy(name) {
    /** @type {{text: string}} */
    const answer = await request("GET", `/programmes/${encodeURIComponent(name)}`);
    this.#text.value = answer.text;
    this.#own.open = true;
    this.#text.focus();
  }

  async #readFile() {
    const file = this.#file.files?.[0];
    if (file) this.#text.value = await file.text();
  }

  async #save() {
    await attemptIn(this.#error, async () => {
      await request("POST", "/programmes", { text: this.#text.value });
      this.#file.value = "";
      notify("Programme saved.");
      await this.#load();
    });
  }

  /** @param {ProgrammeEntry} entry */
  async #remove({ name, title }) {
    const sure = await askConfirmation(
      `Delete programme ${title}?`,
      "You cannot undo this.",
      "Delete programme",
    );
    if (!sure) return;
    await this.#do(() => request("DELETE", `/programmes/${encodeURIComponent(name)}`));
    await this.#load();
  }
}

customElements.define("observer-programmes", Programmes);
