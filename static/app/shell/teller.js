/** What others listen to: events are without detail, and say that something is to be read again. */

export class Teller extends EventTarget {
  /** @param {string} type */
  tell(type) {
    this.dispatchEvent(new Event(type));
  }
}
