/** Fires events without detail: listeners read the changed state themselves. */

export class Emitter extends EventTarget {
  /** @param {string} type */
  emit(type) {
    this.dispatchEvent(new Event(type));
  }
}
