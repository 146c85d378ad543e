/** Driving from this page: sends the held deflection as velocities ten times a second. */

import { COMMAND_FRESH_S, STALE_AFTER_S } from "../elements/facts.js";
import { sentence } from "../elements/words.js";
import { isReadOnly, READ_ONLY_WORDS } from "../shell/access.js";
import { ApiError, request } from "../shell/api.js";
import { Emitter } from "../shell/emitter.js";
import { DriveLink } from "./drive-link.js";
import { Hold } from "./hold.js";
import { isArmed, ROLES } from "./roles.js";

/** @import { RobotNow } from "../contract" */
/** @import { Role } from "./roles.js" */

const SEND_EVERY_MS = 100;
// The server has then stopped the robot, so the page asks for a new press.
const FROZEN_AFTER_MS = 1000 * COMMAND_FRESH_S;
// Nobody consents to what they cannot see.
const UNSEEN_AFTER_MS = 1000 * STALE_AFTER_S;
// Upper limit for manual driving, whatever the robot is capable of.
const MAX_TURN_RATE_RADPS = Math.PI / 2;
const KEY = "dynamic-observer.driving";

/**
 * Events: `change` (role, share, lease, what is held or sent, or the link has changed), `stopping`
 * (stop was pressed here), `stop-failed` (the stop did not reach the server).
 */
export class Driver extends Emitter {
  link = new DriveLink();
  hold = new Hold();
  /** Holds the server's state and the state of the connection to it. */
  #hub;
  #ticked = performance.now();
  /** Why the last hold was blocked, until something is pressed again. */
  note = "";
  /** @type {{role: Role, share: number}} */
  #choice = loadStored();

  /** @param {import("../shell/hub.js").Hub} hub */
  constructor(hub) {
    super();
    this.#hub = hub;
    setInterval(() => this.#tick(), SEND_EVERY_MS);
    this.hold.addEventListener("pressed", () => this.#pressed());
    this.hold.addEventListener("released", () => this.#send(0, 0));
    this.hold.addEventListener("change", () => this.emit("change"));
    for (const type of ["lease", "sent", "link"])
      this.link.addEventListener(type, () => this.#linkChanged());
    this.link.addEventListener("refused", () => this.#block(sentence(this.link.refusal)));
    hub.addEventListener("robots", () => this.#robotsChanged());
    hub.addEventListener("connection", () => this.#connectionChanged());
    // Browsers throttle the timers of hidden pages, so let go and then stay silent.
    document.addEventListener("visibilitychange", () => document.hidden && this.hold.releaseAll());
    for (const type of ["blur", "pagehide", "freeze"])
      window.addEventListener(type, () => this.hold.releaseAll());
  }

  /** The robot chosen for manual driving. */
  get role() {
    return this.#choice.role;
  }

  set role(role) {
    if (role === this.role) return;
    this.hold.releaseAll();
    this.#choose({ role, share: this.share });
  }

  /** Share of the largest permitted speed, 0 to 1. */
  get share() {
    return this.#choice.share;
  }

  set share(share) {
    this.#choose({ role: this.role, share });
  }

  /** @param {Role} [role] @returns {RobotNow | null} */
  robot(role = this.role) {
    return this.#hub.robots?.robots?.[role] ?? null;
  }

  /** True while a robot is armed according to the newest message. */
  get anyArmed() {
    return ROLES.some((role) => isArmed(this.robot(role)));
  }

  get anyConnected() {
    return ROLES.some((role) => this.robot(role) !== null);
  }

  /** The speed and turn rate requested at full deflection. */
  get topSpeed() {
    const limits = this.robot()?.report.limits;
    return {
      speed_mps: (limits?.speed_mps ?? 0) * this.share,
      turn_rate_radps: Math.min(limits?.turn_rate_radps ?? 0, MAX_TURN_RATE_RADPS) * this.share,
    };
  }

  /** Why holding a control would not move the chosen robot; empty if it would. */
  get blockedReason() {
    const robot = this.robot();
    const { robots, connection } = this.#hub;
    if (isReadOnly()) return READ_ONLY_WORDS;
    if (connection !== "open") return "No connection to the server.";
    if (!robot) return "No robot is connected.";
    if (robots?.stopped) return "All robots are stopped: reset the stop first.";
    if (!this.link.leases.has(this.role))
      return robot.operator
        ? sentence(`${robot.operator} has control: take control or wait`)
        : "Arm the robot to drive.";
    if (!isArmed(robot)) return "Arm the robot first.";
    if (robots?.programme) return "A programme is running: stop it first.";
    return "";
  }

  /**
   * Switch the motors on, taking the lease first.
   *
   * @param {Role} role
   * @throws {ApiError} one sentence saying why not
   */
  async arm(role) {
    await this.take(role, false);
    this.link.present(role);
    await request("POST", `/robots/${role}/arm`, { lease: this.link.leases.get(role) ?? null });
  }

  /**
   * Become the one who drives a role.
   *
   * @param {Role} role
   * @param {boolean} takeover also where somebody else does
   * @throws {ApiError} one sentence saying why not
   */
  async take(role, takeover) {
    const refusal = await this.link.take(role, takeover);
    if (refusal) throw new ApiError(sentence(refusal), 409);
  }

  /** Stop all robots through every available channel. */
  async stop() {
    this.hold.releaseAll();
    this.link.stop();
    this.emit("stopping");
    try {
      await request("POST", "/robots/stop");
    } catch (error) {
      this.emit("stop-failed");
      throw error;
    }
  }

  #pressed() {
    const { blockedReason } = this;
    if (blockedReason) return this.hold.block(blockedReason);
    this.note = "";
    // Nothing was held until now: after a deadline expired, the server must first see a zero.
    this.#send(0, 0);
    this.#tick();
  }

  #tick() {
    const now = performance.now();
    const wasFrozen = now - this.#ticked > FROZEN_AFTER_MS;
    this.#ticked = now;
    if (document.hidden) return;
    if (wasFrozen) this.#block("This page froze for a moment: let go and press again.");
    if (now - this.#hub.heardAt > UNSEEN_AFTER_MS)
      return this.#block("The server is not responding: let go and press again.");
    const { topSpeed } = this;
    const held = this.hold.deflection;
    for (const role of this.link.leases.keys()) {
      if (role === this.role && held)
        this.#send(held.forward * topSpeed.speed_mps, held.left * topSpeed.turn_rate_radps);
      else this.link.present(role);
    }
  }

  /** Block the hold although the control has not been released. @param {string} why */
  #block(why) {
    if (!this.hold.isActive) return;
    this.note = why;
    this.hold.block(why);
  }

  /** @param {number} speed_mps @param {number} turn_rate_radps */
  #send(speed_mps, turn_rate_radps) {
    if (this.link.leases.has(this.role)) this.link.drive(this.role, { speed_mps, turn_rate_radps });
  }

  #connectionChanged() {
    if (this.#hub.connection !== "open")
      this.#block("Connection to the server lost: let go and press again.");
    this.emit("change");
  }

  #linkChanged() {
    const { connection, quality, leases } = this.link;
    if (connection !== "open") this.#block("Link lost: let go and press again.");
    else if (quality?.sentence) this.#block(`${quality.sentence}: let go and press again.`);
    else if (!leases.has(this.role)) this.#block("You no longer have control.");
    this.emit("change");
  }

  #robotsChanged() {
    // An older message may still arrive if the user arms and holds at once.
    if (this.#hub.robots?.stopped) this.#block("All robots were stopped.");
    else {
      const robot = this.robot();
      if (robot && !isArmed(robot))
        this.#block(sentence(robot.report.trouble ?? robot.why ?? "the robot was disarmed"));
    }
    this.emit("change");
  }

  /** @param {{role: Role, share: number}} choice */
  #choose(choice) {
    this.#choice = choice;
    localStorage.setItem(KEY, JSON.stringify(choice));
    this.emit("change");
  }
}

/** @returns {{role: Role, share: number}} */
function loadStored() {
  try {
    const { role, share } = JSON.parse(localStorage.getItem(KEY) ?? "{}");
    return {
      role: ROLES.includes(role) ? role : "observer",
      share: share >= 0.05 && share <= 1 ? share : 0.25,
    };
  } catch {
    return { role: "observer", share: 0.25 };
  }
}
