/** A fake page without layout: just enough of the DOM to make a part and press its buttons. */

export class FakeElement extends EventTarget {
  /** @type {(FakeElement | string)[]} */
  #content = [];
  /** @type {Map<string, string>} */
  #attributes = new Map();
  /** @type {FakeElement | null} */
  parent = null;
  isConnected = true;
  hidden = false;
  id = "";
  value = "";
  /** @type {Record<string, string>} */
  dataset = {};
  tabIndex = 0;
  style = { setProperty() {} };
  classList = { add() {} };

  constructor(localName = "observer-part") {
    super();
    this.localName = localName;
  }

  get children() {
    return this.#content.filter((each) => typeof each !== "string");
  }
  get childElementCount() {
    return this.children.length;
  }
  get firstElementChild() {
    return this.children[0] ?? null;
  }
  get valueAsNumber() {
    return this.value === "" ? NaN : Number(this.value);
  }
  /** @returns {string} */
  get textContent() {
    return this.#content
      .map((each) => (typeof each === "string" ? each : each.textContent))
      .join("");
  }
  set textContent(text) {
    this.#content = text ? [text] : [];
  }

  append(/** @type {(FakeElement | string)[]} */ ...content) {
    for (const each of content) this.insertBefore(each, null);
  }
  replaceChildren(/** @type {(FakeElement | string)[]} */ ...content) {
    this.#content = [];
    this.append(...content);
  }
  insertBefore(/** @type {FakeElement | string} */ each, /** @type {FakeElement | null} */ next) {
    if (typeof each !== "string") {
      each.remove();
      each.parent = this;
    }
    this.#content.splice(next ? this.#content.indexOf(next) : this.#content.length, 0, each);
  }
  remove() {
    const content = this.parent ? this.parent.#content : [];
    const at = content.indexOf(this);
    if (at >= 0) content.splice(at, 1);
    this.parent = null;
  }
  /** @param {unknown} other @returns {boolean} */
  contains(other) {
    return other === this || this.children.some((child) => child.contains(other));
  }

  getAttribute(/** @type {string} */ name) {
    return this.#attributes.get(name) ?? null;
  }
  setAttribute(/** @type {string} */ name, /** @type {string} */ value) {
    this.#attributes.set(name, value);
    if (name === "id") this.id = value;
    if (name === "value") this.value = value;
    if (name === "hidden") this.hidden = true;
  }
  removeAttribute(/** @type {string} */ name) {
    this.#attributes.delete(name);
  }
  hasAttribute(/** @type {string} */ name) {
    return this.#attributes.has(name);
  }
  toggleAttribute(/** @type {string} */ name, /** @type {boolean} */ on) {
    if (on) this.#attributes.set(name, "");
    else this.#attributes.delete(name);
  }

  /** @param {string} tags names separated by commas @returns {FakeElement[]} */
  querySelectorAll(tags) {
    const wanted = tags.split(", ");
    return this.children.flatMap((child) => [
      ...(wanted.includes(child.localName) ? [child] : []),
      ...(tags === `[role="${child.getAttribute("role")}"]` ? [child] : []),
      ...child.querySelectorAll(tags),
    ]);
  }
  querySelector(/** @type {string} */ tags) {
    return this.querySelectorAll(tags)[0] ?? null;
  }

  /** @param {string} type @param {object} [details] of the event */
  fire(type, details) {
    const event = new Event(type, { cancelable: true });
    this.dispatchEvent(Object.assign(event, details));
    return event;
  }
  checkVisibility() {
    return true;
  }
  closest() {
    return null;
  }
  getBoundingClientRect() {
    return { left: 0, top: 0, right: 400, bottom: 300, width: 400, height: 300 };
  }
  focus() {}
  scrollIntoView() {}
  getContext() {
    return null;
  }
  close() {}
}

/** @type {Map<string, new () => any>} */
const parts = new Map();

Object.defineProperty(globalThis, "navigator", { value: { userAgent: "", language: "en" } });
Object.assign(globalThis, {
  Node: FakeElement,
  Element: FakeElement,
  HTMLElement: FakeElement,
  devicePixelRatio: 1,
  innerWidth: 1000,
  innerHeight: 500,
  requestAnimationFrame() {},
  customElements: {
    define: (/** @type {string} */ name, /** @type {any} */ part) => parts.set(name, part),
  },
  window: new EventTarget(),
  document: Object.assign(new FakeElement("document"), {
    activeElement: null,
    body: new FakeElement("body"),
    documentElement: new FakeElement("html"),
    getElementById: () => null,
    createElement: (/** @type {string} */ tag) => new FakeElement(tag),
    createElementNS: (/** @type {string} */ _, /** @type {string} */ tag) => new FakeElement(tag),
  }),
  location: { hash: "", protocol: "http:", host: "here" },
  localStorage: { getItem: () => null, setItem() {} },
  matchMedia: () => Object.assign(new EventTarget(), { matches: false }),
  DOMRect: class {},
  ResizeObserver: class {
    observe() {}
    disconnect() {}
  },
});

/** Make a part that its module does not export. @param {string} name of its element */
export function partOf(name) {
  const Made = parts.get(name);
  if (!Made) throw new Error(`no part ${name}`);
  return new Made();
}

/**
 * Return the button with this label or text.
 *
 * @param {unknown} part
 * @param {string} name
 */
export function buttonOf(part, name) {
  const found = /** @type {FakeElement} */ (part)
    .querySelectorAll("button")
    .find((each) => (each.getAttribute("aria-label") ?? each.textContent) === name);
  if (!found) throw new Error(`no button ${name}`);
  return found;
}

/** Let everything happen that waits for no timer. */
export function settled() {
  return new Promise((resolve) => setImmediate(resolve));
}

/**
 * Answer the page's requests.
 *
 * @param {(method: string, path: string, body: any) => unknown} answer JSON or a promise of it; a
 *   refusal if it is an error
 */
export function serve(answer) {
  const fetched = async (/** @type {string} */ url, /** @type {RequestInit} */ options) => {
    const body = options.body ? JSON.parse(String(options.body)) : null;
    const told = await answer(options.method ?? "GET", url.replace("/api", ""), body);
    if (told instanceof Error) return Response.json({ detail: told.message }, { status: 503 });
    return Response.json(told);
  };
  globalThis.fetch = /** @type {typeof fetch} */ (/** @type {unknown} */ (fetched));
}
