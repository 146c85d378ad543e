/** The base of the page's parts: a custom element that listens to the hub while it is shown. */

/** @import { Hub } from "../shell/hub.js" */

export class Part extends HTMLElement {
  /** @type {Hub | null} */
  #hub = null;
  #gone = new AbortController();

  /** The hub; available only after `attach`. */
  get hub() {
    if (!this.#hub) throw new Error(`${this.localName} was used before attach()`);
    return this.#hub;
  }

  /**
   * Connect the part; called once by main.js or by the part that created this one.
   *
   * @param {Hub} hub
   */
  attach(hub) {
    this.#hub = hub;
    this.build();
  }

  /** Create the content and start listening; overridden by each part. */
  build() {}

  /**
   * Listen until this part is removed from the page; a part is never reinserted or moved.
   *
   * @param {string} types events of the hub, separated by spaces
   * @param {(event: Event) => unknown} listener
   * @param {EventTarget} [target] another target to listen to, such as document
   */
  listen(types, listener, target = this.hub) {
    const { signal } = this.#gone;
    for (const type of types.split(" "))
      target.addEventListener(type, (event) => void listener(event), { signal });
  }

  /**
   * Call the listener when the tab that contains this part is opened; for parts that do nothing
   * while hidden.
   *
   * @param {() => void} listener
   */
  whenShown(listener) {
    const panel = this.closest('[role="tabpanel"]');
    if (panel) this.listen("shown", listener, panel);
  }

  disconnectedCallback() {
    this.#gone.abort();
  }
}
