/** Both robots: their state, who drives them, and driving the chosen one. */

import {
  button,
  details,
  field,
  fillList,
  h,
  input,
  setAttribute,
  setText,
  stateChip,
} from "../elements/dom.js";
import { fillFigures } from "../elements/figure-list.js";
import { moveFocus } from "../elements/focus.js";
import { GLOSSARY } from "../elements/glossary.js";
import { Part } from "../elements/part.js";
import { sentence } from "../elements/words.js";
import { ApiError, request } from "../shell/api.js";
import { exclusiveRunner } from "../shell/notice.js";
import { DrivePad } from "./drive-pad.js";
import { PortForm } from "./port-form.js";
import {
  batteryInWords,
  driverInWords,
  figuresOf,
  incidentInWords,
  outdatedReason,
  standstillReason,
  stateInWords,
} from "./robot-words.js";
import { isArmed, ROLE_WORDS, ROLES } from "./roles.js";

/** @import { Hub } from "../shell/hub.js" */
/** @import { Role } from "./roles.js" */

class RobotsPanel extends Part {
  #cards = new Map(ROLES.map((role) => [role, makeCard(role)]));
  #why = h("p.robot-why", { role: "status" });
  #arm = this.#act("Arm", "Not armed", ({ driver }) => driver.arm(driver.role), {
    class: "button primary",
    title: GLOSSARY["armed"],
  });
  #disarm = this.#act("Disarm", "Not disarmed", ({ driver }) =>
    request("POST", `/robots/${driver.role}/disarm`),
  );
  #takeOver = this.#act(
    "Take control",
    "Control not taken",
    ({ driver }) => driver.take(driver.role, true),
    { title: GLOSSARY["control"] },
  );
  #release = button("Release control", () => this.hub.driver.link.release(this.hub.driver.role), {
    title: "Stops and disarms the robot so that others can drive it",
  });
  #trouble = h("p.robot-trouble", { role: "alert", hidden: true });
  #warnings = h("ul.plain-list.warnings", { "aria-label": "Warnings" });
  #figures = h("dl.figures");
  #pad = new DrivePad();
  #incidents = h("ul.plain-list");
  #happened = details("Recent stops", this.#incidents);
  #port = new PortForm();
  #place = details("Port and model", this.#port);
  #name = input("text", "operator-name", { maxlength: "40", autocomplete: "nickname" });
  #refusal = h("p.field-error", { role: "alert" });
  #do = exclusiveRunner(() => this.#render(), this.#refusal);
  #placed = false;

  build() {
    const { driver } = this.hub;
    this.append(
      h("h2", "Robots"),
      this.#trouble,
      h(
        "fieldset.role-cards",
        { "data-harmless": true },
        h("legend.visually-hidden", "Robot"),
        ...[...this.#cards.values()].map(({ element }) => element),
      ),
      h(
        "div.robot-actions",
        this.#why,
        this.#warnings,
        h("div.row", this.#arm, this.#disarm, this.#takeOver, this.#release),
        this.#refusal,
      ),
      this.#pad,
      details("Telemetry", this.#figures),
      this.#happened,
      details(
        "Your name",
        field(
          "Operator name",
          this.#name,
          "Others see this name while you drive. It applies from the next connection.",
        ),
      ),
      this.#place,
    );
    for (const [role, { input }] of this.#cards) {
      input.addEventListener("change", () => {
        if (input.checked) driver.role = role;
      });
    }
    this.#name.value = driver.link.name;
    this.#name.addEventListener("change", () => {
      driver.link.name = this.#name.value;
    });
    this.#pad.attach(this.hub);
    this.#port.attach(this.hub);
    this.listen("robots connection freshness", () => this.#render());
    this.whenShown(() => this.#render());
    this.listen("change", () => this.#render(), driver);
    this.#render();
  }

  /**
   * @param {string} words
   * @param {string} failed begins the error message: what did not happen
   * @param {(hub: Hub) => unknown} act
   * @param {Record<string, unknown>} [more]
   */
  #act(words, failed, act, more) {
    const tried = async () => {
      try {
        await act(this.hub);
      } catch (error) {
        if (!(error instanceof ApiError)) throw error;
        const why = error.message.charAt(0).toLowerCase() + error.message.slice(1);
        throw new ApiError(`${failed}: ${why}`, error.status, error.fields);
      }
    };
    return button(words, () => this.#do(tried), more);
  }

  #render() {
    if (this.offsetParent === null) return;
    const { driver, robots, robotsOutdated: outdated } = this.hub;
    for (const [role, card] of this.#cards) {
      const robot = driver.robot(role);
      card.input.checked = role === driver.role;
      setText(card.name, robot ? (robot.name ?? robot.report.name ?? robot.port) : "");
      setText(card.state, stateInWords(robot));
      setAttribute(card.state, "data-state", robot?.state ?? "none");
      setText(
        card.facts,
        [robot && batteryInWords(robot.report), driverInWords(robot, driver.link.leases.has(role))]
          .filter(Boolean)
          .join(" · "),
      );
    }
    const robot = driver.robot();
    const ours = driver.link.leases.has(driver.role);
    const others = Boolean(robot?.operator) && !ours;
    const armed = isArmed(robot);
    setText(this.#trouble, `${outdatedReason(this.hub)} The values shown here are stale.`);
    this.#trouble.hidden = !outdated || !robots;
    // Stale data do not tell whether or why it is standing still.
    setAttribute(this, "data-old", outdated ? "" : null);
    setText(
      this.#why,
      outdated && robots
        ? ""
        : standstillReason(driver.role, robot, robots, ours, driver.link.operator),
    );
    setAttribute(this.#why, "data-tone", robot?.report.fault || robots?.stopped ? "bad" : null);
    fillList(this.#warnings, (robot?.report.warnings ?? []).map(sentence));
    // After a key press on one of these, the focus moves to a button that can be pressed now.
    const armable = !outdated && robot?.state === "disarmed" && !robots?.stopped;
    if (armable) this.#arm.disabled = false;
    const shown = new Map([
      [this.#arm, !armed && !others],
      [this.#disarm, armed],
      [this.#takeOver, others],
      [this.#release, ours],
    ]);
    for (const [button, isShown] of shown) if (isShown) button.hidden = false;
    for (const [button, isShown] of shown) {
      if (isShown) continue;
      moveFocus(button, this.#arm, this.#disarm, this.#takeOver, this.#release);
      button.hidden = true;
    }
    this.#arm.disabled = !armable;
    fillFigures(this.#figures, robot ? figuresOf(robot) : []);
    const incidents = [...(robots?.incidents ?? [])].reverse();
    this.#happened.hidden = incidents.length === 0;
    fillList(this.#incidents, incidents.map(incidentInWords));
    if (!this.#placed && robots) {
      this.#placed = true;
      this.#place.open = !robot;
    }
  }
}

/** @param {Role} role */
function makeCard(role) {
  const input = h("input", { type: "radio", name: "drive-role", value: role });
  const name = h("span.role-name");
  const state = stateChip("none", "");
  const facts = h("span.hint.figure");
  const element = h(
    "label.role-card",
    input,
    h("span.role-head", h("b", ROLE_WORDS[role]), state),
    name,
    facts,
  );
  return { input, name, state, facts, element };
}

customElements.define("observer-robots", RobotsPanel);
