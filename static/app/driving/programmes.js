/** Programmes: timed velocities that are played while their operator stays present. */

import { ApiError, request } from "../api.js";
import { field, h, icon, setText } from "../dom.js";
import { KeptList } from "../focus-place.js";
import { confirmed, notify, notifyError } from "../notice.js";
import { Part } from "../part.js";
import { sentence } from "../words.js";
import { clock, lastsInWords, ROLE_WORDS } from "./robot-words.js";

/** @typedef {import("./types.js").ProgrammeEntry} ProgrammeEntry */

class Programmes extends Part {
  /** @type {ProgrammeEntry[]} */
  #programmes = [];
  #list = h("ul", { class: "item-list" });
  #kept = new KeptList(this.#list, (/** @type {ProgrammeEntry} */ entry) => this.#item(entry));
  #empty = h("p", { class: "empty" }, "No programme could be read.");
  #repeat = h("input", { type: "number", id: "programme-repeat", min: "1", max: "100", step: "1", value: "1" });
  #reverse = h("input", { type: "checkbox", id: "programme-reverse" });
  #running = h("div", { class: "programme-running", hidden: true });
  #words = h("p", { class: "figure" });
  #progress = h("progress", { max: "1", value: "0", "aria-label": "How far the programme is" });
  #stop = h("button", { type: "button", class: "button" }, icon("stop"), "Stop programme");
  #text = h("textarea", { id: "programme-text", rows: "8", spellcheck: "false", "aria-describedby": "programme-error" });
  #file = h("input", { type: "file", id: "programme-file", accept: ".yaml,.yml,text/yaml" });
  #error = h("p", { class: "field-error", id: "programme-error", role: "alert" });
  #own = h("details", {}, h("summary", {}, "A programme of your own"));
  #busy = false;
  #loaded = false;

  build() {
    const form = h("form", { class: "stack", novalidate: true },
      field("Take it from a file", this.#file),
      field("YAML", this.#text, "Name, title, and for each role steps with seconds, speed_mps and turn_rate_radps. “Copy” beside a programme puts its text here."),
      this.#error,
      h("div", { class: "row" }, h("button", { type: "submit", class: "button primary" }, "Keep programme")));
    this.#own.append(form);
    this.#running.append(this.#words, this.#progress, this.#stop);
    this.append(
      h("h3", {}, "Programmes"),
      h("p", { class: "hint" }, "They go on as long as this page is open and in sight, every robot in them armed by you."),
      this.#running,
      h("div", { class: "row" },
        h("label", { for: "programme-repeat" }, "Repeat"), this.#repeat,
        h("label", { class: "check", for: "programme-reverse" }, this.#reverse, "Both directions")),
      this.#empty, this.#list, this.#own);
    this.#stop.addEventListener("click", () => void this.#do(() => request("DELETE", "/robots/programme")));
    this.#file.addEventListener("change", () => void this.#readFile());
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      void this.#keep();
    });
    this.hear("robots", () => this.#render());
    this.hear("change", () => this.#render(), this.hub.driver);
    this.hear("reconnected", () => {
      this.#loaded = false;
    });
    this.#render();
  }

  async #load() {
    this.#programmes = (await request("GET", "/programmes").catch(() => null)) ?? [];
    this.#render();
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
      const title = this.#programmes.find(({ name }) => name === running.name)?.title ?? running.name;
      const round = running.repeat > 1 ? `, round ${running.round} of ${running.repeat}` : "";
      const phase = running.phase === "gesture" ? "opening gesture" : `${clock(running.elapsed_s)} of ${clock(running.duration_s)}`;
      setText(this.#words, `${title}: ${phase}${round}`);
      this.#progress.value = running.duration_s > 0 ? Math.min(1, running.elapsed_s / running.duration_s) : 0;
    }
    this.#empty.hidden = this.#programmes.length > 0 || !this.#loaded;
    this.#kept.show(this.#programmes, ({ name }) => name);
    for (const entry of this.#programmes) {
      const item = this.#list.querySelector(`[data-programme="${CSS.escape(entry.name)}"]`);
      const start = item?.querySelector("button.start");
      const hint = item?.querySelector(".missing");
      const missing = running ? "" : this.#missing(entry);
      if (start instanceof HTMLButtonElement) start.disabled = Boolean(missing) || running !== null;
      if (hint) setText(hint, missing);
    }
  }

  /** What must be done before it can be started. @param {ProgrammeEntry} entry */
  #missing({ roles }) {
    const { driver, robots } = this.hub;
    if (robots?.stopped) return "Everything is stopped: reset it first.";
    const wanting = roles.flatMap((role) => {
      const robot = driver.robot(role);
      if (!robot) return [`connect the ${ROLE_WORDS[role].toLowerCase()}`];
      const armed = robot.state === "armed" || robot.state === "moving";
      if (!driver.link.leases.has(role)) return [armed && robot.operator ? `take over the ${ROLE_WORDS[role].toLowerCase()}` : `arm the ${ROLE_WORDS[role].toLowerCase()}`];
      return armed ? [] : [`arm the ${ROLE_WORDS[role].toLowerCase()}`];
    });
    return wanting.length ? sentence(`first ${wanting.join(" and ")}`) : "";
  }

  /** @param {ProgrammeEntry} entry */
  #item(entry) {
    const { name, title, help, roles, duration_s, own } = entry;
    const start = h("button", { type: "button", class: "button start", "aria-label": `Start ${title}` }, icon("play"), "Start");
    start.addEventListener("click", () => void this.#do(() => this.#begin(entry)));
    const copy = h("button", { type: "button", class: "button", "aria-label": `Copy ${title}`, title: "Copy its text into the field below" }, "Copy");
    copy.addEventListener("click", () => void this.#do(() => this.#copy(name)));
    const buttons = [start, copy];
    if (own) {
      const remove = h("button", { type: "button", class: "button icon-button", "aria-label": `Delete ${title}`, title: "Delete" }, icon("trash"));
      remove.addEventListener("click", () => void this.#remove(entry));
      buttons.push(remove);
    }
    const who = roles.map((role) => ROLE_WORDS[role]).join(" and ");
    return h("li", { class: "programme", "data-programme": name },
      h("div", { class: "item-words" },
        h("p", {}, h("b", {}, title)),
        h("p", { class: "hint figure" }, `${who} · ${lastsInWords(duration_s)}`),
        help ? h("p", { class: "hint" }, help) : null,
        h("p", { class: "missing" })),
      h("div", { class: "row" }, ...buttons));
  }

  /** @param {ProgrammeEntry} entry */
  async #begin({ name, title, roles }) {
    const { leases } = this.hub.driver.link;
    const repeat = Number(this.#repeat.value);
    if (!Number.isInteger(repeat) || repeat < 1) throw new Error("Repeat must be a whole number from 1.");
    await request("POST", "/robots/programme", {
      name,
      repeat,
      reverse: this.#reverse.checked,
      leases: Object.fromEntries(roles.map((role) => [role, leases.get(role)])),
    });
    notify(`${title} has begun.`);
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

  async #keep() {
    setText(this.#error, "");
    try {
      await request("POST", "/programmes", { text: this.#text.value });
      this.#file.value = "";
      notify("The programme is kept.");
      await this.#load();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      setText(this.#error, error.message);
    }
  }

  /** @param {ProgrammeEntry} entry */
  async #remove({ name, title }) {
    if (!(await confirmed(`Delete ${title}?`, "Its text cannot be brought back.", "Delete programme"))) return;
    await this.#do(() => request("DELETE", `/programmes/${encodeURIComponent(name)}`));
    await this.#load();
  }

  /** @param {() => Promise<unknown>} action */
  async #do(action) {
    if (this.#busy) return;
    this.#busy = true;
    try {
      await action();
    } catch (error) {
      notifyError(error);
    } finally {
      this.#busy = false;
    }
  }
}

customElements.define("observer-programmes", Programmes);
