/** Sources of one kind as tiles: the first few, or all on demand. */

import { button, h, setAttribute, setText, svg } from "../elements/dom.js";
import { KeyedList } from "../elements/focus.js";
import { firstFew } from "./choices.js";

/** @import { SourceEntry } from "../contract" */
/** @import { Choice } from "./choices.js" */
/** @import { PictureQueue } from "./picture-queue.js" */

/** Drawn while there is no picture. @type {Record<SourceEntry["group"], string>} */
const PLACEHOLDER_ICONS = {
  simulated:
    "M8 1.2 14.2 4.6v6.8L8 14.8l-6.2-3.4V4.6zm0 1.7L4.6 4.8 8 6.7l3.4-1.9zM3.3 6v4.5l4 2.2V8.2zm9.4 0-4 2.2v4.5l4-2.2z",
  cameras:
    "M1.5 4.5h3l1-1.5h5l1 1.5h3v8.5h-13zM8 6a2.7 2.7 0 1 0 0 5.4A2.7 2.7 0 0 0 8 6zm0 1.4a1.3 1.3 0 1 1 0 2.6 1.3 1.3 0 0 1 0-2.6z",
  recordings:
    "M1.5 2.5h13v11h-13zM3 4v1.5h1.5V4zm8.5 0v1.5H13V4zM3 7.2v1.6h1.5V7.2zm8.5 0v1.6H13V7.2zM3 10.5V12h1.5v-1.5zm8.5 0V12H13v-1.5zM6 4v3.3h4V4zm0 4.7V12h4V8.7z",
  folders: "M1.5 3h5l1.5 1.8h6.5V13h-13z",
};

export class SourceGroup {
  #few;
  #group;
  #queue;
  #press;
  #list;
  #items;
  /** @type {Choice[]} */
  #choices = [];
  #current = "";
  #shown = "";
  #all = false;
  #more = button("", () => this.#toggle(), { class: "quiet", hidden: true, "data-harmless": true });

  /**
   * @param {SourceEntry["group"]} group
   * @param {string} title
   * @param {number} few how many are shown at first
   * @param {PictureQueue} queue
   * @param {(choice: Choice, tile: HTMLButtonElement) => void} press
   * @param {...HTMLElement} tools next to the title
   */
  constructor(group, title, few, queue, press, ...tools) {
    const id = `sources-${group}`;
    this.#group = group;
    this.#few = few;
    this.#queue = queue;
    this.#press = press;
    this.#list = h("div.source-tiles", {
      id,
      role: "group",
      "aria-labelledby": `${id}-title`,
      "data-few": few,
    });
    this.#items = new KeyedList(
      this.#list,
      (/** @type {Choice} */ choice) => this.#tile(choice),
      () => this.#more,
    );
    setAttribute(this.#more, "aria-controls", id);
    this.element = h(
      "section.source-group",
      h("div.source-head", h("h3", { id: `${id}-title` }, title), ...tools, this.#more),
      this.#list,
    );
  }

  /**
   * @param {Choice[]} choices
   * @param {string} current the spec of the open source
   */
  show(choices, current) {
    this.#choices = choices;
    this.#current = current;
    const few = firstFew(choices, this.#few, current);
    const shown = JSON.stringify([this.#all, choices, few]);
    if (shown === this.#shown) return;
    this.#shown = shown;
    const inserted = [...this.#list.children].filter((child) => !child.matches(".source"));
    const beside = inserted[0]?.previousElementSibling?.getAttribute("data-spec");
    // Until all are requested, create only the first few tiles and fetch only their pictures.
    this.#items.show(
      this.#all ? choices : few,
      ({ spec }) => spec,
      (choice) => JSON.stringify({ ...choice, recent: null }),
    );
    // Messages about a tile stay next to it.
    const tile = [...this.#list.children].find((each) => each.getAttribute("data-spec") === beside);
    if (tile) tile.after(...inserted);
    this.#more.hidden = choices.length <= this.#few;
    setText(this.#more, this.#all ? "Show fewer" : `Show all ${choices.length}`);
    setAttribute(this.#more, "aria-expanded", String(this.#all));
  }

  #toggle() {
    this.#all = !this.#all;
    this.show(this.#choices, this.#current);
  }

  /** @param {Choice} choice */
  #tile(choice) {
    const { spec, title, line, help, picture } = choice;
    const shown = h(
      "span.source-picture",
      svg(
        "svg",
        { viewBox: "0 0 16 16", class: "icon", "aria-hidden": "true" },
        svg("path", { d: PLACEHOLDER_ICONS[this.#group] }),
      ),
    );
    if (picture) {
      const image = h("img", { alt: "", width: 128, height: 64, decoding: "async" });
      shown.append(image);
      this.#queue.add(image, picture);
    }
    const tile = button(
      [shown, h("b", title), h("span.source-line", line)],
      () => this.#press(choice, tile),
      { class: "source", "data-spec": spec, title: help === spec ? spec : `${help}\n${spec}` },
    );
    return tile;
  }
}
