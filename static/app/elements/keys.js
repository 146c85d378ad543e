/** The keys that the page's parts listen to; each part declares its own where it handles them. */

const WRITTEN_IN = ["text", "search", "number", "password", "url", "email", "tel"];

/**
 * @typedef {object} KeyHelp
 * @property {string[]} keys as they stand on the keyboard; any of them does it
 * @property {string} does as in "Stop all robots"
 */

/** @type {Map<string, KeyHelp[]>} */
const declared = new Map();

/**
 * @param {string} place where the keys work, as the heading has it
 * @param {...[string, string]} entries keys with spaces between them, and what they do
 */
export function declareKeys(place, ...entries) {
  const list = declared.get(place) ?? [];
  list.push(...entries.map(([keys, does]) => ({ keys: keys.split(" "), does })));
  declared.set(place, list);
}

/** All that was declared, by place; what works everywhere comes first. */
export function declaredKeys() {
  const order = (/** @type {string} */ place) => (place === "Everywhere" ? "" : place);
  return [...declared].sort(([one], [other]) => order(one).localeCompare(order(other)));
}

/** Say whether a dialog, a menu or the like lies above the page: Esc closes that first. */
export function isCovered() {
  return document.querySelector("dialog[open], :popover-open") !== null;
}

/**
 * Say whether typed text goes into this element.
 *
 * @param {HTMLElement} element
 */
export function writesText(element) {
  if (element instanceof HTMLInputElement) return WRITTEN_IN.includes(element.type);
  // Elements of the viewer's frame are of another window's classes.
  return element.isContentEditable || ["TEXTAREA", "INPUT"].includes(element.tagName);
}
