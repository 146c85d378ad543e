/**
 * Loads parts of the page after its first frame has been painted, so that this comes sooner:
 * visible parts first, then the others, one after another. A part needed earlier is loaded at once.
 * Until it is loaded, its element stays as it is in the document.
 */

import { Part } from "../elements/part.js";
import { notify } from "./notice.js";

/** @import { Hub } from "./hub.js" */

// Used if no frame comes, for example while no source is open.
const LOAD_ANYWAY_AFTER_MS = 1000;

export class LazyParts {
  #hub;
  #modules;
  /** Parts loaded or loading: whether loading succeeded. @type {Map<string, Promise<boolean>>} */
  #loading = new Map();
  /** @type {Set<string>} */
  #attached = new Set();

  /**
   * @param {Hub} hub
   * @param {Record<string, () => Promise<unknown>>} modules functions that import each part's
   *   module, by the name of its element, in loading order
   */
  constructor(hub, modules) {
    this.#hub = hub;
    this.#modules = modules;
    const loadAll = () => void this.#loadAll();
    hub.addEventListener("painted", loadAll, { once: true });
    setTimeout(loadAll, LOAD_ANYWAY_AFTER_MS);
    // Load what was requested while the server was away.
    hub.addEventListener("reconnected", loadAll);
    for (const panel of document.querySelectorAll('[role="tabpanel"]'))
      panel.addEventListener("shown", () => void this.#loadWithin(panel));
  }

  /** @param {string} name of an element @returns {boolean} whether its part is attached */
  has(name) {
    return this.#attached.has(name);
  }

  /**
   * Load and attach a part once. If that fails, a notice says so, and it may be requested again.
   *
   * @param {string} name of its element
   * @returns {Promise<boolean>} whether it is attached
   */
  load(name) {
    const loading = this.#loading.get(name) ?? this.#load(name);
    this.#loading.set(name, loading);
    return loading;
  }

  /** @param {string} name */
  async #load(name) {
    try {
      await this.#modules[name]?.();
    } catch {
      this.#loading.delete(name);
      notify("Part of this page did not load. Reload the page.", "error");
      return false;
    }
    for (const element of elements(name)) if (element instanceof Part) element.attach(this.#hub);
    this.#attached.add(name);
    return true;
  }

  async #loadAll() {
    const names = Object.keys(this.#modules);
    const inSight = names.filter((name) => elements(name).some((each) => each.checkVisibility()));
    await this.#loadInTurn([...inSight, ...names]);
  }

  /**
   * Load a panel's parts. Until they are attached, the panel itself is focusable, so that tabbing
   * does not skip it.
   *
   * @param {Element} panel
   */
  async #loadWithin(panel) {
    const missing = Object.keys(this.#modules).filter(
      (name) => !this.has(name) && elements(name).some((each) => panel.contains(each)),
    );
    if (!missing.length || !(panel instanceof HTMLElement)) return;
    panel.tabIndex = 0;
    panel.setAttribute("aria-busy", "true");
    await this.#loadInTurn(missing);
    panel.removeAttribute("aria-busy");
    const leave = () => panel.removeAttribute("tabindex");
    if (document.activeElement === panel) panel.addEventListener("blur", leave, { once: true });
    else leave();
  }

  /** Load one after another, leaving time for the page. @param {readonly string[]} names */
  async #loadInTurn(names) {
    for (const name of names) if (!(await this.load(name))) return;
  }
}

/** @param {string} name @returns {Element[]} those in the document, not those made by parts */
function elements(name) {
  return [...document.querySelectorAll(`${name}[data-part]`)];
}
