/** Requests whose answers are discarded once a newer one has been made. */

export class LatestRequest {
  #asked = 0;

  /**
   * @template T
   * @param {() => Promise<T>} ask
   * @returns {Promise<T | undefined>} undefined if superseded by a newer request, even if this one
   *   failed
   */
  async run(ask) {
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
