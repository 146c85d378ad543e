/** The server's log as known to this page, and the notices this page has shown. */

import { LOG_LENGTH } from "../elements/facts.js";

/** @import { LogEntry } from "../contract" */
/** @typedef {Pick<LogEntry, "time" | "severity" | "text">} Line */

const MAX_NOTICES = 100;
// The page shows a refusal at about the time the server logs it.
const SAME_S = 10;

export class LogBook {
  /** The server's, oldest first. @type {LogEntry[]} */
  #entries = [];
  /** This page's, oldest first. @type {Line[]} */
  #notices = [];

  /** @param {readonly LogEntry[]} entries all that the server has */
  replace(entries) {
    this.#entries = [...entries];
  }

  /**
   * Add new entries from the server.
   *
   * @param {readonly LogEntry[]} entries oldest first
   * @returns {boolean} false if entries in between were missed: request all
   */
  add(entries) {
    const last = this.#entries.at(-1)?.number ?? 0;
    const fresh = entries.filter(({ number }) => number > last);
    if (fresh[0] && fresh[0].number !== last + 1) return false;
    this.#entries = [...this.#entries, ...fresh].slice(-LOG_LENGTH);
    return true;
  }

  /**
   * Record a notice that was shown.
   *
   * @param {string} text
   * @param {Line["severity"]} severity
   * @param {number} [time] seconds since 1970
   */
  note(text, severity, time = Date.now() / 1000) {
    this.#notices = [...this.#notices, { time, severity, text }].slice(-MAX_NOTICES);
  }

  /** All lines, oldest first. */
  lines() {
    const notices = this.#notices.filter((notice) => !this.#isKnown(notice));
    /** @type {Line[]} */
    const all = [...this.#entries, ...notices];
    return all.sort((one, other) => one.time - other.time);
  }

  /** @param {Line} notice known if the server logged it too, even with a prefix like "Refused: " */
  #isKnown({ time, text }) {
    return this.#entries.some(
      (entry) => Math.abs(entry.time - time) < SAME_S && entry.text.endsWith(text.slice(1)),
    );
  }

  /** All lines as text. */
  text() {
    return this.lines()
      .map(
        ({ time, severity, text }) =>
          `${new Date(time * 1000).toISOString()} ${severity.toUpperCase()} ${text}\n`,
      )
      .join("");
  }
}
