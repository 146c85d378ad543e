/** The log: what has happened that the user should know, newest first. */

import { button, download, h, setText } from "../elements/dom.js";
import { Part } from "../elements/part.js";
import { request } from "./api.js";
import { LogBook } from "./log-book.js";
import { NOTICE_SHOWN, attempt } from "./notice.js";

/** @import { LogPage } from "../contract" */
/** @import { Line } from "./log-book.js" */

const SEVERITIES = { info: "Info", warning: "Warning", error: "Error" };

class Log extends Part {
  #book = new LogBook();
  #asked = false;
  #list = h("ol.log", { tabindex: 0, "aria-label": "Log entries, newest first" });
  #empty = h("p.hint");
  #important = h("input", { type: "checkbox", id: "log-important", "data-harmless": true });

  build() {
    const save = () => download(new Blob([this.#book.text()]), "dynamic-observer-log.txt");
    this.append(
      h("h3", "Log"),
      h(
        "div.row.log-head",
        h("label.log-filter", this.#important, "Only warnings and errors"),
        button("Save as text", save),
      ),
      this.#empty,
      this.#list,
    );
    this.#important.addEventListener("change", () => this.#render());
    this.listen("log", () => this.#take());
    this.listen("status", () => this.#askFirst());
    this.listen("reconnected", () => this.#ask());
    window.addEventListener(NOTICE_SHOWN, (event) => {
      if (event instanceof CustomEvent) this.#book.note(event.detail.text, event.detail.severity);
      this.#render();
    });
    this.whenShown(() => this.#render());
  }

  #askFirst() {
    if (this.#asked) return;
    this.#asked = true;
    this.#ask();
  }

  #ask() {
    void attempt(async () => {
      const page = /** @type {LogPage} */ (await request("GET", "/log"));
      this.#book.replace(page.entries);
      this.#render();
    });
  }

  #take() {
    if (this.#book.add(this.hub.log)) this.#render();
    // Some entries were missed.
    else this.#ask();
  }

  #render() {
    if (!this.checkVisibility()) return;
    const lines = this.#book.lines();
    const wanted = this.#important.checked
      ? lines.filter(({ severity }) => severity !== "info")
      : lines;
    this.#list.replaceChildren(...wanted.reverse().map(row));
    this.#list.hidden = wanted.length === 0;
    setText(
      this.#empty,
      wanted.length > 0 ? "" : lines.length > 0 ? "No warnings or errors." : "No entries yet.",
    );
  }
}

/** @param {Line} line */
function row({ time, severity, text }) {
  const at = new Date(time * 1000);
  return h(
    "li",
    { "data-severity": severity },
    h(
      "time.figure",
      { datetime: at.toISOString(), title: at.toLocaleString() },
      at.toLocaleTimeString(undefined, { hour12: false }),
    ),
    h("span.log-severity", SEVERITIES[severity]),
    h("span.log-text", text),
  );
}

customElements.define("observer-log", Log);
