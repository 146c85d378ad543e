/** Pictures that are fetched a few at a time, so that nothing else of the page waits for them. */

// A browser has six connections to a server, and making a picture may take seconds.
const AT_ONCE = 2;

export class PictureQueue {
  /** @type {{image: HTMLImageElement, address: string}[]} */
  #waiting = [];
  #going = 0;

  /**
   * Fetch a picture when it is its turn; what has none, or is gone from the page, stays as it is.
   *
   * @param {HTMLImageElement} image
   * @param {string} address
   */
  add(image, address) {
    this.#waiting.push({ image, address });
    this.go();
  }

  /** Go on; pictures that nobody can see wait until somebody can. */
  go() {
    // After what is being put into the page now.
    queueMicrotask(() => this.#next());
  }

  #next() {
    this.#waiting = this.#waiting.filter(({ image }) => image.isConnected);
    while (this.#going < AT_ONCE) {
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
