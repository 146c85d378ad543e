/** The observer's goal: where it is to drive autonomously, its progress, and why it ended. */

import {
  button,
  details,
  field,
  h,
  icon,
  input,
  offer,
  onSubmit,
  select,
  setAttribute,
  setText,
} from "../elements/dom.js";
import { moveFocus } from "../elements/focus.js";
import { FARTHEST_GOAL_M } from "../elements/facts.js";
import { GLOSSARY } from "../elements/glossary.js";
import { GoalExplanation } from "../elements/goal-explanation.js";
import { Part } from "../elements/part.js";
import { fixed } from "../elements/words.js";
import { isReadOnly, READ_ONLY_WORDS } from "../shell/access.js";
import { ApiError, request } from "../shell/api.js";
import { storeOf } from "../parameters/parameter-store.js";
import { exclusiveRunner, showError } from "../shell/notice.js";
import { openPane } from "../shell/splitter.js";
import {
  parseGoal,
  missingForGoal,
  refusalSentence,
  placeInWords,
  RISK_PARAMETER,
  riskChoices,
  tooFarReason,
  stripNumbers,
} from "./goal-words.js";
import { clock } from "./robot-words.js";

/** @import { GoalNow, ProgrammeDetail } from "../contract" */
/** @import { FloorPlace } from "../shell/floor-pick.js" */

const ROLE = "observer";
const FIELDS = {
  min: -FARTHEST_GOAL_M,
  max: FARTHEST_GOAL_M,
  step: "any",
  "aria-describedby": "goal-error",
};
// The scene shows the outcome of a click for this long.
const OUTCOME_SHOWN_MS = 6000;
// Plans arrive ten times a second, faster than their reasons can be read.
const EXPLAINED_EVERY_MS = 500;

class GoalPanel extends Part {
  #ahead = input("number", "goal-ahead", { ...FIELDS, value: "2" });
  #left = input("number", "goal-left", { ...FIELDS, value: "0" });
  #error = h("p.field-error", { id: "goal-error", role: "alert" });
  #risk = select({ id: "goal-risk" }, riskChoices(undefined));
  #send = h("button.button.primary", { type: "submit" }, icon("play"), "Drive there");
  #pick = button("Pick a goal", () => this.#togglePick(), {
    title: "Click the floor in the 3D scene; an armed observer drives there at once",
  });
  #missing = h("p.missing", { id: "goal-missing" });
  #refusal = h("p.field-error", { role: "alert" });
  #sentence = h("p.goal-sentence");
  /** The same for screen readers, but not announced each time a number changes. */
  #spoken = h("p.visually-hidden", { role: "status" });
  #progress = h("p.figure");
  #why = new GoalExplanation();
  #whyDetails = details("Why", this.#why);
  /** What the explanation was last filled with, and when, ms. */
  #explained = { news: "", at: 0 };
  #cancelError = h("p.field-error", { role: "alert" });
  #runCancel = exclusiveRunner(undefined, this.#cancelError);
  #cancel = button([icon("stop"), "Cancel goal"], () =>
    this.#runCancel(() => withOutcome("Not cancelled", () => request("DELETE", "/goal"))),
  );
  #driving = h(
    "div.goal-driving",
    { hidden: true },
    // Above the sentence, so that it stays put however many lines that has.
    h("div.goal-head", this.#progress, this.#cancel),
    this.#cancelError,
    this.#sentence,
    this.#whyDetails,
  );
  #ended = h("p.goal-ended", { role: "status", hidden: true });
  #do = exclusiveRunner(undefined, this.#refusal);
  /** Whether the click requested last is sent at once. */
  #sendsOnPick = false;
  /** The programme last seen running. @type {ProgrammeDetail | null} */
  #programme = null;
  #asked = "";

  build() {
    const { floorPick, driver } = this.hub;
    const parameters = storeOf(this.hub);
    parameters.subscribe("values", () =>
      offer(this.#risk, riskChoices(parameters.state.values[RISK_PARAMETER])),
    );
    this.#send.setAttribute("aria-describedby", "goal-missing");
    const form = h(
      "form.stack",
      { novalidate: true },
      h(
        "div.goal-fields",
        field("Ahead (m)", this.#ahead),
        field("Left (m)", this.#left),
        h("p.hint", "From the robot's current pose. Negative: behind it, to its right."),
      ),
      this.#error,
      details(
        "Advanced",
        field(
          "Risk per metre",
          this.#risk,
          "Accepted probability of touching a tracked obstacle per metre driven. The lower it is, the longer the observer waits and the wider it passes. It does not cover what the cameras have not seen.",
        ),
      ),
      h("div.row", this.#send, this.#pick),
      this.#missing,
      this.#refusal,
    );
    this.append(
      h("h3", { title: GLOSSARY["goal"] }, "Drive to a goal"),
      h(
        "p.hint",
        "The observer drives there by itself, around obstacles, only while this page is open and visible. Driving by hand ends it. Tested in simulation only.",
      ),
      this.#driving,
      this.#spoken,
      this.#ended,
      form,
    );
    onSubmit(form, () => this.#do(() => this.#sendTyped()));
    this.#whyDetails.addEventListener("toggle", () => this.#render());
    this.listen("robots connection freshness", () => this.#render());
    this.listen("change", () => this.#render(), driver);
    this.listen("change", () => this.#render(), floorPick);
    this.listen("picked", () => this.#do(() => this.#sendPicked()), floorPick);
    this.whenShown(() => this.#render());
    this.#render();
  }

  /** What is missing before a goal can be sent; empty if nothing. */
  get #missingReason() {
    if (isReadOnly()) return READ_ONLY_WORDS;
    const { driver, robots } = this.hub;
    const running = robots?.programme && this.#programme;
    const moves = running && running.roles.includes(ROLE) ? running.title : "";
    const ours = driver.link.leases.has(ROLE);
    return missingForGoal(this.hub, ours, moves);
  }

  async #sendTyped() {
    showError(this.#error, "");
    const place = parseGoal(this.#ahead.value, this.#left.value);
    if (typeof place === "string") {
      showError(this.#error, refusalSentence("Not sent", place));
      this.#ahead.focus();
      return;
    }
    await this.#post(place);
  }

  /** Use the place clicked in the scene: send it if nothing was missing, else only enter it. */
  async #sendPicked() {
    const { place } = this.hub.floorPick;
    if (!place) return;
    showError(this.#error, "");
    this.#ahead.value = place.ahead.toFixed(2);
    this.#left.value = place.left.toFixed(2);
    if (!this.#sendsOnPick) {
      this.#showInScene(`Entered but not sent: ${placeInWords(place)}.`);
      return;
    }
    try {
      await this.#post(place);
      this.#showInScene(`Goal sent: ${placeInWords(place)}.`);
    } catch (error) {
      if (error instanceof ApiError) this.#showInScene(error.message, true);
      throw error;
    }
  }

  /** @param {FloorPlace} place */
  async #post(place) {
    const lease = this.hub.driver.link.leases.get(ROLE);
    const why = tooFarReason(place) || this.#missingReason;
    if (why || !lease) throw new ApiError(refusalSentence("Not sent", why), 409);
    const { ahead, left } = place;
    await withOutcome("Not sent", () =>
      request("POST", "/goal", {
        ahead_m: ahead,
        left_m: left,
        risk_per_metre: this.#risk.value === "" ? null : Number(this.#risk.value),
        lease,
      }),
    );
  }

  #togglePick() {
    const { floorPick } = this.hub;
    if (floorPick.asked) {
      floorPick.cancel();
      return;
    }
    openPane("main");
    const seen = document.querySelector("observer-scene")?.checkVisibility();
    showError(this.#refusal, seen ? "" : "No goal picked: the 3D scene is not visible.");
    if (!seen) return;
    // Fixed until the click, so that the click does what the user was told before.
    this.#sendsOnPick = this.#missingReason === "";
    floorPick.ask(
      this.#sendsOnPick
        ? "Click the floor: the observer drives there at once."
        : "Click the floor: the place is entered, but not sent.",
    );
  }

  /** Show the click's outcome in the scene, too. @param {string} words @param {boolean} [bad] */
  #showInScene(words, bad = false) {
    const { floorPick } = this.hub;
    floorPick.say(words, bad);
    setTimeout(() => floorPick.words === words && floorPick.say(""), OUTCOME_SHOWN_MS);
  }

  #render() {
    if (this.offsetParent === null) return;
    const { robots, floorPick, robotsOutdated } = this.hub;
    void this.#askProgramme();
    setAttribute(this, "data-old", robotsOutdated ? "" : null);
    const goal = robots?.goal ?? null;
    const drives = goal?.state === "driving";
    // Not to a field if possible: phones open their keyboard, and Enter would send the goal again.
    if (!drives) moveFocus(this.#driving, this.#pick, this.#ahead);
    const ends = !drives && !this.#driving.hidden;
    this.#driving.hidden = !drives;
    if (ends && !floorPick.asked) floorPick.say("");
    if (goal && drives) this.#renderDriving(goal);
    else setText(this.#spoken, "");
    const ended = goal && !drives ? goal.sentence : "";
    setText(this.#ended, ended);
    this.#ended.hidden = !ended;
    const missing = this.#missingReason;
    setText(this.#missing, missing);
    this.#send.disabled = missing !== "";
    setText(this.#pick, floorPick.asked ? "Cancel picking" : "Pick a goal");
    this.#pick.hidden = !floorPick.possible;
  }

  /** @param {GoalNow} goal */
  #renderDriving(goal) {
    setText(this.#sentence, goal.sentence);
    if (stripNumbers(this.#spoken.textContent ?? "") !== stripNumbers(goal.sentence))
      setText(this.#spoken, goal.sentence);
    const left =
      goal.distance_m === null ? "Distance unknown" : `${fixed(goal.distance_m, 1)} m to go`;
    setText(this.#progress, `${left} · ${clock(goal.elapsed_s)}`);
    if (!this.#whyDetails.open) return;
    const now = performance.now();
    const news = `${stripNumbers(goal.sentence)} ${goal.waits_for}`;
    if (news === this.#explained.news && now - this.#explained.at < EXPLAINED_EVERY_MS) return;
    this.#explained = { news, at: now };
    this.#why.show(goal);
  }

  /** Find out which robots the running programme moves. */
  async #askProgramme() {
    const name = this.hub.robots?.programme?.name ?? "";
    if (name === this.#asked) return;
    this.#asked = name;
    this.#programme = null;
    if (!name) return;
    /** @type {ProgrammeDetail | null} */
    const answer = await request("GET", `/programmes/${encodeURIComponent(name)}`).catch(
      () => null,
    );
    if (name !== this.#asked) return;
    this.#programme = answer;
    this.#render();
  }
}

/**
 * Ask the server; errors begin with what did not happen.
 *
 * @param {string} what
 * @param {() => Promise<unknown>} ask
 */
async function withOutcome(what, ask) {
  try {
    await ask();
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    throw new ApiError(refusalSentence(what, error.message), error.status, error.fields);
  }
}

customElements.define("observer-goal", GoalPanel);
