/** Keeping the keyboard focus while the focused element is changed or removed. */

/**
 * Call this before `from` is hidden, disabled or removed: the focus moves on to the first of `to`
 * that can take it. Nothing happens if the focus is elsewhere.
 *
 * @param {Element} from
 * @param {...(HTMLElement | null | undefined)} to
 */
export function moveFocus(from, ...to) {
  if (!from.contains(document.activeElement)) return;
  for (const each of to) {
    if (!each || from.contains(each) || !each.checkVisibility()) continue;
    each.focus();
    if (document.activeElement === each) return;
  }
}

/**
 * Give the focus back to the element that had it, or to the button of the menu that contains it if
 * the menu has closed, or to the side panel's tab if both are gone.
 *
 * @param {Element | null} caller
 */
export function restoreFocus(caller) {
  const menu = caller?.closest("[popover]")?.id;
  const next = [
    caller === document.body ? null : caller,
    menu ? document.querySelector(`[popovertarget="${menu}"]`) : null,
    document.querySelector('[role="tab"][aria-selected="true"]'),
  ].find((each) => each?.checkVisibility());
  if (next instanceof HTMLElement) next.focus();
}

/**
 * Move the focus to the heading of a view that opened, with a ring only if there was one before:
 * if nothing had the focus, browsers draw one although no key was pressed.
 *
 * @param {HTMLElement} heading
 */
export function focusHeading(heading) {
  heading.toggleAttribute("data-ring", document.activeElement?.matches(":focus-visible"));
  heading.focus();
}

/**
 * A list whose entries keep their elements while their content is the same, so that neither the
 * pointer nor the keyboard loses its place when the list is shown again.
 *
 * @template T
 */
export class KeyedList {
  #list;
  #make;
  #fallback;
  /** @type {Map<string, {drawn: string, element: HTMLElement}>} */
  #entries = new Map();

  /**
   * @param {HTMLElement} list
   * @param {(item: T) => HTMLElement} make
   * @param {() => (HTMLElement | null)} fallback gets the focus when no entry is left
   */
  constructor(list, make, fallback = () => null) {
    this.#list = list;
    this.#make = make;
    this.#fallback = fallback;
  }

  /**
   * @param {T[]} items
   * @param {(item: T) => string} key identifies an item
   * @param {(item: T) => string} drawn content of its entry; if it changes, the entry is rebuilt
   */
  show(items, key, drawn = (item) => JSON.stringify(item)) {
    const place = this.#focused();
    /** @type {Map<string, {drawn: string, element: HTMLElement}>} */
    const entries = new Map();
    for (const item of items) {
      const kept = this.#entries.get(key(item));
      const now = drawn(item);
      entries.set(
        key(item),
        kept?.drawn === now ? kept : { drawn: now, element: this.#make(item) },
      );
    }
    this.#entries = entries;
    this.#arrange([...entries.values()].map(({ element }) => element));
    if (place) this.#restore(place);
  }

  /** Move only elements that are out of place: moving an element makes it lose the focus. */
  #arrange(/** @type {HTMLElement[]} */ elements) {
    const wanted = new Set(/** @type {Element[]} */ (elements));
    for (const child of [...this.#list.children]) if (!wanted.has(child)) child.remove();
    for (const [at, element] of elements.entries()) {
      const there = this.#list.children[at];
      if (there !== element) this.#list.insertBefore(element, there ?? null);
    }
  }

  /** @returns {{element: Element, row: number, control: number} | null} */
  #focused() {
    const element = document.activeElement;
    if (!element || !this.#list.contains(element)) return null;
    const row = [...this.#list.children].findIndex((child) => child.contains(element));
    const entry = this.#list.children[row];
    return {
      element,
      row,
      control: entry ? controls(entry).indexOf(/** @type {HTMLElement} */ (element)) : 0,
    };
  }

  /** @param {{element: Element, row: number, control: number}} place */
  #restore({ element, row, control }) {
    if (element.isConnected)
      return element === document.activeElement
        ? undefined
        : /** @type {HTMLElement} */ (element).focus();
    const entry = this.#list.children[Math.min(row, this.#list.children.length - 1)];
    const there = entry ? controls(entry) : [];
    const usable = there[control]?.matches(":disabled")
      ? there.find((each) => !each.matches(":disabled"))
      : there[control];
    (usable ?? this.#fallback())?.focus();
  }
}

/** @param {Element} entry */
function controls(entry) {
  return /** @type {HTMLElement[]} */ ([
    ...entry.querySelectorAll("button, a[href], input, select, summary"),
  ]);
}
