/** The values with which each method was left, so that switching back and forth loses nothing. */

/** @import { Values } from "./parameter-store.js" */
/** @typedef {{basedOn: string, values: Values}} Left */

const KEY = "dynamic-observer.methods";

export class MethodMemory {
  /** @type {Record<string, Left>} */
  #left;
  #storage;

  /** @param {Pick<Storage, "getItem" | "setItem">} [storage] keeps the values across reloads */
  constructor(storage = localStorage) {
    this.#storage = storage;
    this.#left = read(storage);
  }

  /**
   * @param {string} method
   * @param {Left | null} left null forgets it
   */
  remember(method, left) {
    if (left) this.#left[method] = left;
    else delete this.#left[method];
    this.#storage.setItem(KEY, JSON.stringify(this.#left));
  }

  /** @param {string} method @returns {Left | null} null if it was never in force */
  recall(method) {
    return this.#left[method] ?? null;
  }
}

/** @param {Pick<Storage, "getItem">} storage @returns {Record<string, Left>} */
function read(storage) {
  try {
    const kept = JSON.parse(storage.getItem(KEY) ?? "{}");
    const sound = Object.entries(kept).filter(
      ([, left]) => typeof left?.basedOn === "string" && typeof left?.values === "object",
    );
    return Object.fromEntries(sound);
  } catch {
    return {};
  }
}
