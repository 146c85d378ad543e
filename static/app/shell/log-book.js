/** The server's log as this page knows it, and the notices that this page has shown. */

/** @import { LogEntry } from "../contract" */
/** @typedef {Pick<LogEntry, "time" | "severity" | "text">} Line */

// As many as the server keeps.
const MOST = 500;
const MOST_NOTICES = 100;
// A refusal that the server has logged is shown by the page at about the same time.
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
   * Add what the server has told.
   *
   * @param {readonly LogEntry[]} told oldest first
   * @returns {boolean} false where some in between were missed: ask for all
   */
  add(told) {
    const last = this.#entries.at(-1)?.number ?? 0;
    const fresh = told.filter(({ number }) => number > last);
    if (fresh[0] && fresh[0].number !== last + 1) return false;
    this.#entries = [...this.#entries, ...fresh].slice(-MOST);
    return true;
  }

  /**
   * Keep a notice that was shown.
   *
   * @param {string} text
   * @param {Line["severity"]} severity
   * @param {number} [time] seconds since 1970
   */
  note(text, severity, time = Date.now() / 1000) {
    this.#notices = [...this.#notices, { time, severity, text }].slice(-MOST_NOTICES);
  }

  /** All lines, oldest first. */
  lines() {
    const notices = this.#notices.filter((notice) => !this.#isKnown(notice));
    /** @type {Line[]} */
    const all = [...this.#entries, ...notices];
    return all.sort((one, other) => one.time - other.time);
  }

  /** @param {Line} notice what the server has said with another beginning, as in "Refused: " */
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
