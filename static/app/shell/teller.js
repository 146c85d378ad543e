/** Fires events without detail: listeners read the changed state themselves. */

export class Teller extends EventTarget {
  /** @param {string} type */
  tell(type) {
    this.dispatchEvent(new Event(type));
  }
}
