/** The drive socket: leases, velocities, heartbeats and link quality. */

import { LiveSocket } from "../shell/live-socket.js";
import { Emitter } from "../shell/emitter.js";

/** @import { LinkMessage, SentMessage, Velocity } from "../contract" */
/** @import { Role } from "./roles.js" */
/** @import { Connection } from "../shell/live-socket.js" */

const ANSWER_MS = 4000;
const PATH = "/api/drive";
const NAME_KEY = "dynamic-observer.operator";

/**
 * One socket is one operator; its leases end with it and are never requested again automatically.
 *
 * Events: `lease` (a lease was granted, refused or lost), `sent`, `refused` (a command was
 * rejected; see `refusal`), `link` (its quality, or whether it is open).
 */
export class DriveLink extends Emitter {
  /** Leases in force. @type {Map<Role, string>} */
  leases = new Map();
  /** @type {Connection} */
  connection = "closed";
  /** @type {LinkMessage | null} */
  quality = null;
  /** Velocities sent for the newest command. @type {Map<Role, SentMessage>} */
  sent = new Map();
  /** Why the newest command was rejected. */
  refusal = "";

  /** The server's name for this operator; empty until connected. */
  operator = "";

  #sequence = 0;
  /** Lease requests not answered yet. @type {Map<Role, {takeover: boolean, done: (sentence: string | null) => void}>} */
  #asked = new Map();
  #socket = new LiveSocket(() => this.#path, {
    message: (message) => this.#receive(message),
    state: (state) => this.#connectionChanged(state),
  });

  /** The name this operator has chosen; used from the next connection on. */
  get name() {
    return localStorage.getItem(NAME_KEY) ?? "";
  }

  set name(name) {
    localStorage.setItem(NAME_KEY, name.trim());
  }

  /**
   * Take control of a role.
   *
   * @param {Role} role
   * @param {boolean} takeover take it even from another operator
   * @returns {Promise<string | null>} one sentence saying why not; null: the lease is ours
   */
  take(role, takeover) {
    if (this.leases.has(role)) return Promise.resolve(null);
    this.#answer(role, "Superseded by a newer request.");
    return new Promise((resolve) => {
      const timer = setTimeout(
        () => this.#answer(role, "The server is not responding."),
        ANSWER_MS,
      );
      this.#asked.set(role, {
        takeover,
        done: (sentence) => {
          clearTimeout(timer);
          resolve(sentence);
        },
      });
      if (this.connection === "open") this.#ask(role);
      else this.#socket.open();
    });
  }

  /** @param {Role} role */
  release(role) {
    this.#socket.send({ type: "release", role });
    this.leases.delete(role);
    this.emit("lease");
  }

  /**
   * @param {Role} role
   * @param {Velocity} velocity
   */
  drive(role, { speed_mps, turn_rate_radps }) {
    this.#socket.send({
      type: "drive",
      role,
      sequence: this.#next(),
      time: performance.now(),
      speed_mps,
      turn_rate_radps,
    });
  }

  /** @param {Role} role */
  present(role) {
    this.#socket.send({ type: "present", role, sequence: this.#next(), time: performance.now() });
  }

  stop() {
    this.#socket.send({ type: "stop" });
  }

  get #path() {
    return this.name ? `${PATH}?name=${encodeURIComponent(this.name)}` : PATH;
  }

  #next() {
    this.#sequence += 1;
    return this.#sequence;
  }

  /** @param {Role} role */
  #ask(role) {
    this.#socket.send({ type: "take", role, takeover: this.#asked.get(role)?.takeover ?? false });
  }

  /**
   * @param {Role} role
   * @param {string | null} sentence
   */
  #answer(role, sentence) {
    const asked = this.#asked.get(role);
    this.#asked.delete(role);
    asked?.done(sentence);
  }

  /** @param {any} message */
  #receive(message) {
    if (message.type === "ping") {
      this.#socket.send({ type: "pong", id: message.id, time: performance.now() });
    } else if (message.type === "operator") {
      this.operator = message.name;
    } else if (message.type === "lease") {
      this.#leaseChanged(message);
    } else if (message.type === "sent") {
      this.sent.set(message.role, message);
      this.emit("sent");
    } else if (message.type === "refused") {
      this.refusal = message.sentence;
      this.emit("refused");
    } else if (message.type === "link") {
      this.quality = message;
      this.emit("link");
    }
  }

  /** @param {{role: Role, state: string, lease: string | null, holder: string | null, sentence: string | null}} message */
  #leaseChanged({ role, state, lease, holder, sentence }) {
    if (state === "yours" && lease) this.leases.set(role, lease);
    else if (state === "lost") this.leases.delete(role);
    const why = sentence ?? (holder ? `${holder} has control.` : "Control was refused.");
    if (state !== "lost") this.#answer(role, state === "yours" ? null : why);
    this.emit("lease");
  }

  /** @param {Connection} state */
  #connectionChanged(state) {
    this.connection = state;
    if (state === "open") {
      for (const role of this.#asked.keys()) this.#ask(role);
    } else if (state === "closed") {
      this.leases.clear();
      this.sent.clear();
      this.quality = null;
      this.emit("lease");
    }
    this.emit("link");
  }
}
