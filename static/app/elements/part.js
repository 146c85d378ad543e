/** The base of the page's parts: a custom element that listens to the hub while it is shown. */

/** @import { Hub } from "../shell/hub.js" */

export class Part extends HTMLElement {
  /** @type {Hub | null} */
  #hub = null;
  #gone = new AbortController();

  /** The hub; parts may only ask for it after `attach`. */
  get hub() {
    if (!this.#hub) throw new Error(`${this.localName} was used before attach()`);
    return this.#hub;
  }

  /**
   * Called once by main.js (or by the part that made this one).
   *
   * @param {Hub} hub
   */
  attach(hub) {
    this.#hub = hub;
    this.build();
  }

  /** Make the content and start listening; each part has its own. */
  build() {}

  /**
   * Listen until this part is taken out of the page; a part is never put back or moved.
   *
   * @param {string} types events of the hub, with spaces between them
   * @param {(event: Event) => unknown} listener
   * @param {EventTarget} [target] another thing to listen to, as in document
   */
  hear(types, listener, target = this.hub) {
    const { signal } = this.#gone;
    for (const type of types.split(" "))
      target.addEventListener(type, (event) => void listener(event), { signal });
  }

  /**
   * Listen for the tab in which this part stands being opened; for parts that do nothing while
   * they are not seen.
   *
   * @param {() => void} listener
   */
  whenShown(listener) {
    const panel = this.closest('[role="tabpanel"]');
    if (panel) this.hear("shown", listener, panel);
  }

  disconnectedCallback() {
    this.#gone.abort();
  }
}
