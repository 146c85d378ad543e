/**
 * <observer-export-menu>: a button with a menu of all exports of what is shown.
 *
 * Follows the keyboard pattern for menus: arrows, Home, End, first letters, Escape.
 */

import { button, h, icon, setAttribute, setText } from "./dom.js";

/**
 * @typedef {object} MenuItem
 * @property {string} words
 * @property {string} help one line, or a size
 * @property {() => unknown} take
 */

/** @typedef {{title: string, items: MenuItem[]}} MenuGroup */

export class ExportMenu extends HTMLElement {
  #words = h("span", "Export");
  #busy = false;
  #open = button(
    [icon("download"), this.#words, icon("more")],
    () => this.#toggle(this.#list.hidden && !this.#busy),
    {
      "aria-haspopup": "menu",
      "aria-expanded": "false",
    },
  );
  #list = h("div.menu-box.menu-list", { role: "menu", "aria-label": "Export", hidden: true });
  #groups;

  /** @param {() => MenuGroup[]} groups called when it opens */
  constructor(groups = () => []) {
    super();
    this.#groups = groups;
    this.addEventListener("keydown", (event) => this.#pressed(event));
    this.addEventListener("focusout", (event) => {
      if (!(event.relatedTarget instanceof Node && this.contains(event.relatedTarget)))
        this.#toggle(false);
    });
  }

  connectedCallback() {
    this.classList.add("menu");
    if (!this.childElementCount) this.append(this.#open, this.#list);
  }

  focus() {
    this.#open.focus();
  }

  /** Show that an export is running; stay closed until it ends. @param {Promise<unknown>} made */
  async during(made) {
    this.#setBusy(true);
    await made.finally(() => this.#setBusy(false));
  }

  /** @param {boolean} busy */
  #setBusy(busy) {
    this.#busy = busy;
    // Not disabled: that would lose the focus.
    setAttribute(this.#open, "aria-disabled", String(busy));
    setText(this.#words, busy ? "Exporting…" : "Export");
  }

  /** @param {boolean} open */
  #toggle(open) {
    this.#list.hidden = !open;
    setAttribute(this.#open, "aria-expanded", String(open));
    if (!open) return;
    this.#list.replaceChildren(
      ...this.#groups().map(({ title, items }) =>
        h(
          "div",
          { role: "group", "aria-label": title },
          h("p.hint", { "aria-hidden": "true" }, title),
          ...items.map((item) => this.#entry(item)),
        ),
      ),
    );
    this.#items[0]?.focus();
  }

  /** @param {MenuItem} item */
  #entry({ words, help, take }) {
    const taken = () => {
      this.#open.focus();
      this.#toggle(false);
      return take();
    };
    return button([h("b", words), h("span.hint", help)], taken, {
      class: "menu-item",
      role: "menuitem",
      tabindex: -1,
    });
  }

  get #items() {
    return /** @type {HTMLElement[]} */ ([...this.#list.querySelectorAll("[role=menuitem]")]);
  }

  /** @param {KeyboardEvent} event */
  #pressed(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const opens = event.target === this.#open && ["ArrowDown", "ArrowUp"].includes(event.key);
    if (this.#list.hidden) {
      if (!opens) return;
      event.preventDefault();
      this.#toggle(true);
      if (event.key === "ArrowUp") this.#items.at(-1)?.focus();
      return;
    }
    if (event.key === "Escape") {
      event.stopPropagation();
      this.#open.focus();
      return this.#toggle(false);
    }
    const next = this.#next(event.key);
    if (!next) return;
    event.preventDefault();
    next.focus();
  }

  /** @param {string} key @returns {HTMLElement | undefined} the item that it leads to */
  #next(key) {
    const items = this.#items;
    const at = items.findIndex((item) => item === document.activeElement);
    if (key === "ArrowDown") return items[(at + 1) % items.length];
    if (key === "ArrowUp") return items.at(at <= 0 ? -1 : at - 1);
    if (key === "Home") return items[0];
    if (key === "End") return items.at(-1);
    if (key.length !== 1 || key === " ") return undefined;
    const letter = key.toLowerCase();
    return [...items.slice(at + 1), ...items].find((item) =>
      item.textContent?.toLowerCase().startsWith(letter),
    );
  }
}

customElements.define("observer-export-menu", ExportMenu);
