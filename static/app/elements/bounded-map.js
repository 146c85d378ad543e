/**
 * A map that keeps only the newest entries; adding one too many drops the oldest.
 *
 * @template Key
 * @template Value
 * @extends {Map<Key, Value>}
 */
export class BoundedMap extends Map {
  #most;
  #dropped;

  /**
   * @param {number} most entries to keep
   * @param {(key: Key, value: Value) => void} [dropped] called for each dropped entry
   */
  constructor(most, dropped = () => {}) {
    super();
    this.#most = most;
    this.#dropped = dropped;
  }

  /** @param {Key} key @param {Value} value */
  set(key, value) {
    super.set(key, value);
    for (const [oldest, old] of this) {
      if (this.size <= this.#most) break;
      this.delete(oldest);
      this.#dropped(oldest, old);
    }
    return this;
  }
}
