/** A WebSocket that parses messages and reconnects when it is lost. */

import { HEARTBEAT_S, SESSION_OVER } from "../elements/facts.js";
import { leaveIfSignedOut, goToSignIn } from "./session.js";

/** @typedef {"connecting" | "open" | "closed"} Connection */

const RETRY_MS = [250, 500, 1000, 2000];
// A socket silent for this long is given up.
const SILENT_MS = 15 * 1000 * HEARTBEAT_S;
const CHECK_EVERY_MS = 500;

export class LiveSocket {
  /** @type {WebSocket | null} */
  #socket = null;
  #attempt = 0;
  #lastMessageAt = 0;
  #retry = 0;
  #checkedAt = 0;
  #path;
  /** False until it is first opened: nothing else may connect it. */
  #wanted = false;

  /**
   * @param {() => string} path as in "/api/live"; asked for at each connection
   * @param {object} handlers
   * @param {(message: any) => void} handlers.message one parsed message
   * @param {(state: Connection) => void} handlers.state
   */
  constructor(path, handlers) {
    this.#path = path;
    this.handlers = handlers;
    setInterval(() => this.#closeIfSilent(), CHECK_EVERY_MS);
    window.addEventListener("online", () => {
      if (this.#wanted) this.open();
    });
  }

  /** Open now, unless it is already open or opening. */
  open() {
    this.#wanted = true;
    if (this.#socket) return;
    clearTimeout(this.#retry);
    this.handlers.state("connecting");
    const socket = new WebSocket(socketUrl(this.#path()));
    let opened = false;
    this.#socket = socket;
    this.#lastMessageAt = performance.now();
    socket.addEventListener("message", (event) => {
      this.#lastMessageAt = performance.now();
      this.#attempt = 0;
      this.handlers.message(JSON.parse(event.data));
    });
    socket.addEventListener("open", () => {
      opened = true;
      if (this.#socket === socket) this.handlers.state("open");
    });
    socket.addEventListener("close", ({ code }) => {
      if (code === SESSION_OVER) goToSignIn();
      // Browsers hide why a handshake was refused.
      else if (!opened) void leaveIfSignedOut();
      this.#lost(socket);
    });
  }

  /** @param {object} message dropped while the socket is not open */
  send(message) {
    if (this.#socket?.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(message));
  }

  #closeIfSilent() {
    const socket = this.#socket;
    const now = performance.now();
    // If the page itself was held up (asleep, drawing slowly), messages are still to be read.
    if (now - this.#checkedAt > 2 * CHECK_EVERY_MS) this.#lastMessageAt = now;
    this.#checkedAt = now;
    if (socket && now - this.#lastMessageAt > SILENT_MS) {
      // A dead peer may delay the close event for long: do not wait for it.
      this.#lost(socket);
      socket.close();
    }
  }

  /** @param {WebSocket} socket */
  #lost(socket) {
    if (this.#socket !== socket) return;
    this.#socket = null;
    this.handlers.state("closed");
    const delay = RETRY_MS[Math.min(this.#attempt, RETRY_MS.length - 1)] ?? 1000;
    this.#attempt += 1;
    this.#retry = setTimeout(() => this.open(), delay);
  }
}

/**
 * Return the WebSocket address of a path on the same host.
 *
 * @param {string} path
 */
export function socketUrl(path) {
  return `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`;
}
