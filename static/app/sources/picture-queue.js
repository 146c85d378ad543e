/** Fetches pictures a few at a time, so that nothing else on the page has to wait for them. */

// A browser has six connections per server, and rendering a picture may take seconds.
const MAX_CONCURRENT = 2;

export class PictureQueue {
  /** @type {{image: HTMLImageElement, address: string}[]} */
  #waiting = [];
  #going = 0;

  /**
   * Fetch a picture when its turn comes; an image removed from the page meanwhile is skipped.
   *
   * @param {HTMLImageElement} image
   * @param {string} address
   */
  add(image, address) {
    this.#waiting.push({ image, address });
    this.go();
  }

  /** Continue; hidden pictures wait until they are visible. */
  go() {
    // After the elements now being inserted into the page.
    queueMicrotask(() => this.#next());
  }

  #next() {
    this.#waiting = this.#waiting.filter(({ image }) => image.isConnected);
    while (this.#going < MAX_CONCURRENT) {
      const at = this.#waiting.findIndex(({ image }) => image.checkVisibility());
      const [next] = at < 0 ? [] : this.#waiting.splice(at, 1);
      if (!next) return;
      this.#going += 1;
      const done = () => {
        this.#going -= 1;
        this.go();
      };
      next.image.addEventListener("load", done, { once: true });
      next.image.addEventListener("error", done, { once: true });
      next.image.src = next.address;
    }
  }
}
