/** Manual driving: the pad to hold, the speed, what was sent, and what limits it. */

import { h, input, setAttribute, setText } from "../elements/dom.js";
import { SONAR_HALF_ANGLE_DEG } from "../elements/facts.js";
import { GLOSSARY } from "../elements/glossary.js";
import { Part } from "../elements/part.js";
import { age, fixed, sentence } from "../elements/words.js";
import { storeOf } from "../parameters/parameter-store.js";
import { connected, followGamepad } from "./hold-gamepad.js";
import { followKeys } from "./hold-keys.js";
import { applyDeadZone } from "./hold.js";
import { degrees, heldBackReason, velocityInWords } from "./robot-words.js";
import { sonarInWords, SonarRing } from "./sonar-ring.js";

/** @import { RobotNow, SentMessage } from "../contract" */

// Largest knob travel from the pad's centre, as a share of its width.
const KNOB_TRAVEL_PERCENT = 36;
const HALF_ANGLE = "guard.sonar_half_angle_deg";

/** @type {Record<string, string>} */
const LEVELS = { clear: "Path clear", slow: "Slowed", stop: "Stopped" };
/** @type {Record<string, string>} */
const LINKS = { good: "Link good", slow: "Link slow", lost: "Link lost" };
/** @type {Record<string, string>} */
const LINK_CHIPS = { good: "running", slow: "connecting", lost: "failed" };

export class DrivePad extends Part {
  #knob = h("span.pad-knob", { "aria-hidden": "true" });
  #pad = h(
    "div.drive-pad",
    {
      tabindex: "0",
      role: "application",
      "aria-labelledby": "pad-name",
      "aria-describedby": "pad-help pad-state",
    },
    h("span.pad-cross", { "aria-hidden": "true" }),
    this.#knob,
  );
  #ring = new SonarRing();
  #sonar = h("p.hint.figure");
  #state = h("p.pad-state", { id: "pad-state", role: "status" });
  #share = input("range", "drive-share", { min: "5", max: "100", step: "5" });
  #fastest = h("span.figure");
  #sent = h("p.figure.drive-sent");
  #limit = h("p.drive-limit");
  #link = h("span.state-chip");
  #delay = h("span.hint.figure");
  #guard = h("p.guard-words");
  #guardNumbers = h("p.hint.figure");
  /** The pointer holding the pad. @type {number | null} */
  #pointer = null;
  /** Where the pad was when it was pressed: it counts even if the page has moved it since. */
  #box = new DOMRect();

  build() {
    const { driver } = this.hub;
    this.append(
      h("h3", { id: "pad-name" }, "Drive by hand"),
      h(
        "div.pad-row",
        h("div.pad-cell", this.#pad, h("p.hint", "Press, hold and drag")),
        h("div.pad-cell", this.#ring.element, this.#sonar),
      ),
      this.#state,
      h("div.field", h("label", { for: "drive-share" }, "Max speed ", this.#fastest), this.#share),
      this.#sent,
      this.#limit,
      h("div.row", this.#link, this.#delay),
      this.#guard,
      this.#guardNumbers,
      h(
        "p.hint",
        { id: "pad-help" },
        "The robot moves only while you hold the pad, W A S D, the arrow keys, or a gamepad's shoulder button with the left stick. Let go and it stops. While a robot is armed, Space and Esc stop all robots, even while you type.",
      ),
    );
    this.#share.value = String(Math.round(driver.share * 100));
    this.#share.addEventListener("input", () => {
      driver.share = Number(this.#share.value) / 100;
    });
    this.#followPointer();
    followKeys(driver);
    followGamepad(driver);
    this.listen("cleared", () => this.#drop(), driver.hold);
    this.listen("change", () => this.#render(), driver);
    this.listen("robots", () => this.#render());
    this.whenShown(() => this.#render());
    this.listen("gamepadconnected gamepaddisconnected", () => this.#render(), window);
    this.#render();
  }

  #followPointer() {
    const pad = this.#pad;
    pad.addEventListener("pointerdown", (event) => {
      if (this.#pointer !== null || event.button !== 0 || !event.isPrimary) return;
      event.preventDefault();
      pad.focus({ preventScroll: true });
      pad.setPointerCapture(event.pointerId);
      this.#pointer = event.pointerId;
      this.#box = pad.getBoundingClientRect();
      this.#deflect(event);
    });
    pad.addEventListener("pointermove", (event) => {
      if (event.pointerId !== this.#pointer) return;
      // It was released somewhere we got no event from.
      if (event.buttons === 0) this.#release();
      else this.#deflect(event);
    });
    for (const type of ["pointerup", "pointercancel", "lostpointercapture"]) {
      pad.addEventListener(type, (event) => {
        if (event instanceof PointerEvent && event.pointerId === this.#pointer) this.#release();
      });
    }
    pad.addEventListener("contextmenu", (event) => {
      event.preventDefault();
      this.#release();
    });
    pad.addEventListener("blur", () => this.#release());
  }

  /** @param {PointerEvent} event */
  #deflect(event) {
    const box = this.#box;
    const right = (2 * (event.clientX - box.left)) / box.width - 1;
    const down = (2 * (event.clientY - box.top)) / box.height - 1;
    this.hub.driver.hold.set("pad", { forward: -applyDeadZone(down), left: -applyDeadZone(right) });
  }

  #release() {
    this.#drop();
    this.hub.driver.hold.release("pad");
  }

  #drop() {
    const pointer = this.#pointer;
    this.#pointer = null;
    if (pointer !== null && this.#pad.hasPointerCapture(pointer))
      this.#pad.releasePointerCapture(pointer);
  }

  #render() {
    if (this.offsetParent === null) return;
    const { driver } = this.hub;
    const robot = driver.robot();
    const { hold, topSpeed, blockedReason } = driver;
    const deflection = hold.deflection;
    const reply = hold.isActive ? driver.link.sent.get(driver.role) : null;
    const heldBack = heldBackReason(reply);
    const drives = hold.isActive && !heldBack;
    setAttribute(this, "data-held", drives ? "" : hold.isHeld ? "blocked" : null);
    setAttribute(this.#pad, "aria-disabled", blockedReason ? "true" : null);
    const { forward, left } = deflection ?? { forward: 0, left: 0 };
    // Keep the knob within the round pad even if both axes are at full deflection.
    const way = KNOB_TRAVEL_PERCENT / Math.max(1, Math.hypot(forward, left));
    this.#knob.style.left = `${50 - way * left}%`;
    this.#knob.style.top = `${50 - way * forward}%`;
    const { values } = storeOf(this.hub).state;
    this.#ring.show(robot, Number(values[HALF_ANGLE] ?? SONAR_HALF_ANGLE_DEG));
    setText(this.#sonar, robot ? sonarInWords(robot) : "");
    const why = hold.blockedReason || blockedReason || driver.note || heldBack;
    setText(
      this.#state,
      why ||
        (hold.isActive
          ? `Driving the ${driver.role}`
          : `Ready to drive the ${driver.role}${connected() ? ", gamepad connected" : ""}`),
    );
    setAttribute(
      this.#state,
      "data-tone",
      hold.blockedReason || heldBack || (driver.note && !blockedReason && !hold.isActive)
        ? "bad"
        : blockedReason
          ? "calm"
          : "ready",
    );
    setText(
      this.#fastest,
      topSpeed.speed_mps > 0
        ? `${fixed(topSpeed.speed_mps, 2)} m/s, ${fixed(degrees(topSpeed.turn_rate_radps), 0)} °/s`
        : `${Math.round(driver.share * 100)} %`,
    );
    this.#renderSent(reply, heldBack !== "" && why === heldBack);
    this.#renderLink();
    this.#renderGuard(robot);
  }

  /**
   * @param {SentMessage | null | undefined} reply to the newest command
   * @param {boolean} limitShown whether the limit is shown already, as the reason why it stands still
   */
  #renderSent(reply, limitShown) {
    const sent = reply ?? this.hub.driver.robot()?.sent;
    setText(this.#sent, `Sent: ${sent ? velocityInWords(sent) : "–"}`);
    const limit = limitShown ? null : reply?.limited_by;
    setText(this.#limit, limit ? `Limited: ${limit}` : "");
    this.#limit.hidden = !limit;
  }

  #renderLink() {
    const { connection, quality, operator } = this.hub.driver.link;
    const open = connection === "open";
    // The link is opened only when the user first wants to drive; until then it says nothing.
    const state = open ? (quality?.quality ?? "good") : operator ? "lost" : "none";
    this.#link.hidden = state === "none";
    setText(this.#link, LINKS[state] ?? "");
    setAttribute(this.#link, "data-state", LINK_CHIPS[state] ?? "idle");
    const parts = [];
    if (open && quality?.rtt_ms != null) parts.push(`${fixed(quality.rtt_ms, 0)} ms round trip`);
    if (open && quality?.sentence) parts.push(sentence(quality.sentence));
    setText(this.#delay, parts.join(" · "));
  }

  /** @param {RobotNow | null} robot */
  #renderGuard(robot) {
    const guard = robot?.guard ?? null;
    setAttribute(this.#guard, "data-level", guard?.level ?? null);
    const why = guard?.reason ? `: ${guard.reason}` : "";
    setText(
      this.#guard,
      guard ? `Guard: ${LEVELS[guard.level] ?? guard.level}${why}` : "Guard: no data yet",
    );
    setAttribute(
      this.#guard,
      "title",
      why.includes("degraded") ? `Degraded: ${GLOSSARY["degraded"]}` : GLOSSARY["guard"],
    );
    this.#guard.hidden = !robot;
    const sight = this.hub.robots?.sight;
    const degraded = sight?.status && sight.status !== "ok" ? `, ${sight.status}` : "";
    const parts = [];
    if (guard && guard.limit_mps !== null) parts.push(`Limit ${fixed(guard.limit_mps, 2)} m/s`);
    if (this.hub.driver.role === "observer" && sight) {
      parts.push(
        sight.age_s === null ? "No vision data" : `Vision data ${age(sight.age_s)} old${degraded}`,
      );
    }
    setText(this.#guardNumbers, parts.join(" · "));
    this.#guardNumbers.hidden = parts.length === 0;
  }
}

customElements.define("observer-drive-pad", DrivePad);
