/**
 * A text field with suggestions, following the pattern of a combobox with a list box. Arrows move
 * through the suggestions, Enter takes the marked one, Escape closes; any text may be typed.
 */

import { h, setAttribute } from "../elements/dom.js";

/**
 * @template T
 */
export class Combobox {
  #input;
  #list;
  #draw;
  /** @type {T[]} */
  #items = [];
  #marked = -1;
  /** Whether suggestions were requested and not closed; the list then shows if there are any. */
  #wanted = false;

  /** Called when the suggestions have to be updated for the field's text. */
  asked = () => {};

  /** Called with the suggestion that was taken. @type {(item: T) => void} */
  taken = () => {};

  /**
   * @param {HTMLInputElement} input
   * @param {string} label of the list
   * @param {(item: T) => (Node | string)[]} draw what an entry shows
   */
  constructor(input, label, draw) {
    this.#input = input;
    this.#draw = draw;
    this.#list = h("ul.suggestions", {
      id: `${input.id}-list`,
      role: "listbox",
      "aria-label": label,
      hidden: true,
    });
    for (const [name, value] of Object.entries({
      role: "combobox",
      "aria-autocomplete": "list",
      "aria-expanded": "false",
      "aria-controls": this.#list.id,
    }))
      setAttribute(input, name, value);
    this.element = h("div.combobox", input, this.#list);
    input.addEventListener("input", () => this.#open());
    input.addEventListener("click", () => this.#open());
    input.addEventListener("keydown", (event) => this.#pressed(event));
    input.addEventListener("blur", () => this.close());
    // Keep the focus in the field, as its blur would close the list before the click.
    this.#list.addEventListener("pointerdown", (event) => event.preventDefault());
  }

  /** @returns {boolean} */
  get isOpen() {
    return !this.#list.hidden;
  }

  /**
   * Show these items if the list is open; the marked one stays marked if it is still among them.
   *
   * @param {T[]} items
   * @param {(item: T) => string} key
   */
  show(items, key) {
    const before = this.#items[this.#marked];
    const marked = before === undefined ? null : key(before);
    this.#items = items;
    this.#list.replaceChildren(...items.map((item, at) => this.#option(item, at)));
    this.#expand();
    this.#mark(marked === null ? -1 : items.findIndex((item) => key(item) === marked));
  }

  close() {
    this.#wanted = false;
    this.#expand();
    this.#mark(-1);
  }

  #open() {
    this.#wanted = true;
    this.#mark(-1);
    this.asked();
  }

  #expand() {
    const shown = this.#wanted && this.#items.length > 0;
    this.#list.hidden = !shown;
    setAttribute(this.#input, "aria-expanded", String(shown));
  }

  /** @param {T} item @param {number} at */
  #option(item, at) {
    const option = h("li", {
      role: "option",
      id: `${this.#list.id}-${at}`,
      "aria-selected": "false",
    });
    option.append(...this.#draw(item));
    option.addEventListener("click", () => this.#take(item));
    return option;
  }

  /** @param {T} item */
  #take(item) {
    this.close();
    this.taken(item);
  }

  /** @param {KeyboardEvent} event */
  #pressed(event) {
    const { key, altKey } = event;
    if (key === "ArrowDown" || key === "ArrowUp") {
      event.preventDefault();
      const opened = !this.isOpen;
      if (opened) this.#open();
      const count = this.#items.length;
      // With Alt the list opens with nothing marked.
      if (count === 0 || (opened && altKey)) return;
      const step = key === "ArrowDown" ? 1 : -1;
      // After the last item and before the first comes the field itself.
      this.#mark(((this.#marked + 1 + step + count + 1) % (count + 1)) - 1);
    } else if (key === "Enter") {
      const item = this.#items[this.#marked];
      if (this.isOpen && item !== undefined) {
        event.preventDefault();
        this.#take(item);
      } else this.close();
    } else if (key === "Escape") {
      // Do not stop its propagation: Escape also stops robots.
      if (this.isOpen) event.preventDefault();
      this.close();
    }
  }

  /** @param {number} at -1 marks none */
  #mark(at) {
    this.#marked = at;
    for (const [k, option] of [...this.#list.children].entries())
      setAttribute(option, "aria-selected", String(k === at));
    const option = this.#list.children[at];
    setAttribute(this.#input, "aria-activedescendant", option?.id ?? null);
    option?.scrollIntoView({ block: "nearest" });
  }
}
