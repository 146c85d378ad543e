/** Making and filling elements without a framework. */

/** @typedef {Node | string | number | null | undefined | false} Child */

/**
 * An element with attributes, listeners and children.
 *
 * Attributes are set by name; `class` and `for` are written as in HTML, `on` holds listeners,
 * `true` sets an empty attribute and `false`, `null` and `undefined` leave it out.
 *
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, unknown>} [attributes]
 * @param {...Child} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "on") {
      const listeners = /** @type {Record<string, EventListener>} */ (value);
      for (const [type, listener] of Object.entries(listeners)) {
        element.addEventListener(type, listener);
      }
    } else if (value !== false && value !== null && value !== undefined) {
      element.setAttribute(name, value === true ? "" : String(value));
    }
  }
  element.append(...children.filter(isShown).map(asNode));
  return element;
}

/**
 * A control under its label, with a line of help where there is one.
 *
 * @param {string} words
 * @param {HTMLElement} control
 * @param {string} [help]
 */
export function field(words, control, help) {
  return h(
    "div",
    { class: "field" },
    h("label", { for: control.id }, words),
    control,
    help ? h("p", { class: "hint" }, help) : null,
  );
}

/**
 * Set the text only where it differs, so that nothing is laid out without need.
 *
 * @param {Node} node
 * @param {string} text
 */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/**
 * @param {Element} element
 * @param {string} name
 * @param {string | null} value null removes the attribute
 */
export function setAttribute(element, name, value) {
  if (value === null) element.removeAttribute(name);
  else if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

/**
 * Lines of words, made anew only where they differ.
 *
 * @param {HTMLUListElement} list
 * @param {string[]} lines
 */
export function fillList(list, lines) {
  const shown = [...list.children].map(({ textContent }) => textContent);
  if (shown.length === lines.length && lines.every((line, at) => line === shown[at])) return;
  list.replaceChildren(...lines.map((line) => h("li", {}, line)));
}

/**
 * One of the page's icons, drawn in the text's colour.
 *
 * @param {keyof typeof ICONS} name
 */
export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

const ICONS = {
  play: "M4 2.5v11l9-5.5z",
  pause: "M4 2.5h3v11H4zM9 2.5h3v11H9z",
  step: "M3 2.5v11L10 8zM11 2.5h2v11h-2z",
  restart: "M8 3a5 5 0 1 1-4.6 3h1.9A3.3 3.3 0 1 0 8 4.7V7L4 3.8 8 .6z",
  loop: "M4 4h7V2l3.5 3L11 8V6H5.5v2H4zM12 12H5v2L1.5 11 5 8v2h5.5V8H12z",
  stop: "M3 3h10v10H3z",
  record: "M8 3a5 5 0 1 0 0 10A5 5 0 0 0 8 3z",
  undo: "M6.5 2.5 2 6.5l4.5 4V8H10a2.2 2.2 0 0 1 0 4.5H6V14h4a3.8 3.8 0 0 0 0-7.5H6.5z",
  redo: "M9.5 2.5 14 6.5l-4.5 4V8H6a2.2 2.2 0 0 0 0 4.5h4V14H6a3.8 3.8 0 0 1 0-7.5h3.5z",
  close:
    "M3.5 2.4 8 6.9l4.5-4.5 1.1 1.1L9.1 8l4.5 4.5-1.1 1.1L8 9.1l-4.5 4.5-1.1-1.1L6.9 8 2.4 3.5z",
  download: "M7.2 2h1.6v6.2l2.3-2.3 1.1 1.1L8 11.2 3.8 7l1.1-1.1 2.3 2.3zM3 12.5h10V14H3z",
  upload: "M8 2l4.2 4.2-1.1 1.1-2.3-2.3v6.2H7.2V5L4.9 7.3 3.8 6.2zM3 12.5h10V14H3z",
  trash: "M6 2h4v1.2h3.5v1.5h-11V3.2H6zM3.6 5.8h8.8l-.7 8.2H4.3z",
  sun: "M8 5a3 3 0 1 0 0 6 3 3 0 0 0 0-6zM7.3 1h1.4v2.3H7.3zM7.3 12.7h1.4V15H7.3zM1 7.3h2.3v1.4H1zM12.7 7.3H15v1.4h-2.3zM2.6 3.6l1-1 1.6 1.6-1 1zM10.8 11.8l1-1 1.6 1.6-1 1zM2.6 12.4l1.6-1.6 1 1-1.6 1.6zM10.8 4.2l1.6-1.6 1 1-1.6 1.6z",
  moon: "M6.2 1.8A6.5 6.5 0 1 0 14.3 10 5.3 5.3 0 0 1 6.2 1.8z",
  auto: "M8 1.5a6.5 6.5 0 1 0 0 13zM8 1.5v1.3a5.2 5.2 0 0 1 0 10.4v1.3a6.5 6.5 0 0 0 0-13z",
};

/** @param {Child} child @returns {child is Node | string | number} */
function isShown(child) {
  return child !== null && child !== undefined && child !== false;
}

/** @param {Node | string | number} child */
function asNode(child) {
  return child instanceof Node ? child : String(child);
}
