/** Questions whose older answers no longer count once a newer one was asked. */

export class Newest {
  #asked = 0;

  /**
   * @template T
   * @param {() => Promise<T>} ask
   * @returns {Promise<T | undefined>} undefined where something newer was asked meanwhile, also
   *   instead of an error
   */
  async answer(ask) {
    const asked = ++this.#asked;
    try {
      const answer = await ask();
      return asked === this.#asked ? answer : undefined;
    } catch (error) {
      if (asked === this.#asked) throw error;
      return undefined;
    }
  }
}
