/** Keyboard shortcuts of the page; each part declares its own where it handles them. */

const WRITTEN_IN = ["text", "search", "number", "password", "url", "email", "tel"];

/**
 * @typedef {object} KeyHelp
 * @property {string[]} keys as labelled on the keyboard; any of them does it
 * @property {string} does as in "Stop all robots"
 */

// Elements that use Space themselves.
const OWN_SPACE = 'button, summary, select, input, a, [role="tab"], [contenteditable]';

/** @type {Map<string, KeyHelp[]>} */
const declared = new Map();

/**
 * @param {string} place where the keys work, as in the heading
 * @param {...[string, string]} entries keys separated by spaces, and what they do
 */
export function declareKeys(place, ...entries) {
  const list = declared.get(place) ?? [];
  list.push(...entries.map(([keys, does]) => ({ keys: keys.split(" "), does })));
  declared.set(place, list);
}

/** Return all declared keys by place; those that work everywhere come first. */
export function declaredKeys() {
  const late = (/** @type {string} */ place) => Number(!place.startsWith("Everywhere"));
  return [...declared].sort(
    ([one], [other]) => late(one) - late(other) || one.localeCompare(other),
  );
}

/** Return whether a dialog, menu or the like covers the page: Esc closes that first. */
export function isCovered() {
  return document.querySelector("dialog[open], :popover-open") !== null;
}

/**
 * Return whether typed text goes into this element.
 *
 * @param {HTMLElement} element
 */
export function writesText(element) {
  if (element instanceof HTMLInputElement) return WRITTEN_IN.includes(element.type);
  // Elements in the viewer's frame are instances of another window's classes.
  return element.isContentEditable || ["TEXTAREA", "INPUT"].includes(element.tagName);
}

/**
 * Return whether the element, or what it is part of, uses Space itself: a field, a button, a menu.
 *
 * @param {HTMLElement | null} element
 */
export function usesSpace(element) {
  return Boolean(element?.closest?.(`${OWN_SPACE}, dialog, [popover]`));
}

/**
 * Make Space play, wherever the focus is on the page of a player that is ready for it. While a
 * robot is armed, Space does not get here: it stops the robots. See driving/stop-keys.js.
 *
 * @param {import("./part.js").Part} player
 * @param {() => boolean} isShown
 * @param {() => void} toggle play or pause
 */
export function playOnSpace(player, isShown, toggle) {
  const pressed = (/** @type {Event} */ event) => {
    if (event.defaultPrevented) return;
    const { code, repeat, ctrlKey, metaKey, altKey } = /** @type {KeyboardEvent} */ (event);
    if (code !== "Space" || ctrlKey || metaKey || altKey || !isShown()) return;
    const target = /** @type {HTMLElement | null} */ (event.target);
    // A slider does nothing with Space.
    if (usesSpace(target) && !target?.matches?.('[type="range"]')) return;
    event.preventDefault();
    if (!repeat) toggle();
  };
  player.listen("keydown", pressed, document);
}
