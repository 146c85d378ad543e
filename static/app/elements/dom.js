/** Making and filling elements without a framework. */

/** @typedef {Node | string | number | null | undefined | false} Child */
/** @typedef {keyof HTMLElementTagNameMap} Tag */
/** @template T @typedef {T extends `${infer K extends Tag}.${string}` ? K : T extends Tag ? T : never} TagOf */

/**
 * Make an element with attributes and children.
 *
 * Classes may follow the tag, as in "p.hint". Attributes are set by name, as in HTML; `true` sets
 * an empty attribute and `false`, `null` and `undefined` omit it.
 *
 * @template {Tag | `${Tag}.${string}`} T
 * @param {T} tag
 * @param {...(Child | Record<string, unknown>)} content attributes and children
 * @returns {HTMLElementTagNameMap[TagOf<T>]}
 */
export function h(tag, ...content) {
  const [name = "", ...classes] = tag.split(".");
  const element = document.createElement(name);
  if (classes.length > 0) element.className = classes.join(" ");
  for (const each of content) {
    if (each === null || each === undefined || each === false) continue;
    if (typeof each !== "object") element.append(String(each));
    else if (each instanceof Node) element.append(each);
    else setAttributes(element, each);
  }
  return /** @type {HTMLElementTagNameMap[TagOf<T>]} */ (element);
}

/**
 * Make an SVG element.
 *
 * @template {keyof SVGElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, unknown>} attributes
 * @param {...(Node | string)} children
 */
export function svg(tag, attributes, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  setAttributes(element, attributes);
  element.append(...children);
  return element;
}

/** @param {Element} element @param {Record<string, unknown>} attributes */
function setAttributes(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    element.setAttribute(name, value === true ? "" : String(value));
  }
}

/** @typedef {Child | Child[]} Words label of a button, with an icon before it or an icon alone */

/**
 * Make a button that does not submit a form.
 *
 * @param {Words} words
 * @param {(() => unknown) | null} pressed what it does; null: the caller listens itself
 * @param {Record<string, unknown>} [attributes]
 */
export function button(words, pressed, attributes) {
  const element = h(
    "button",
    { type: "button", class: "button", ...attributes },
    ...[words].flat(),
  );
  if (pressed) element.addEventListener("click", () => void pressed());
  return element;
}

/**
 * Make a button that shows an icon; its name is the tooltip and the accessible label.
 *
 * @param {keyof typeof ICONS} name
 * @param {string} label
 * @param {(() => unknown) | null} pressed
 * @param {Record<string, unknown>} [attributes]
 */
export function iconButton(name, label, pressed, attributes) {
  return button(icon(name), pressed, {
    class: "button icon-button",
    "aria-label": label,
    title: label,
    ...attributes,
  });
}

/**
 * Make a button offer Pause while playing, else Play.
 *
 * @param {HTMLElement} element
 * @param {boolean} playing
 */
export function offerPlayback(element, playing) {
  const words = playing ? "Pause" : "Play";
  if (element.getAttribute("aria-label") === words && element.childElementCount) return;
  setAttribute(element, "aria-label", words);
  setAttribute(element, "title", words);
  element.replaceChildren(icon(playing ? "pause" : "play"));
}

/**
 * Make a download link that looks like a button.
 *
 * @param {string} words
 * @param {Record<string, unknown>} attributes its target and the file name
 */
export function downloadLink(words, attributes) {
  return h("a.button", { download: true, ...attributes }, icon("download"), words);
}

/**
 * Make a drop-down list.
 *
 * @param {Record<string, unknown>} attributes
 * @param {(readonly string[])[]} choices value and words of each
 */
export function select(attributes, choices) {
  return h("select", attributes, ...options(choices));
}

/** @param {(readonly string[])[]} choices */
function options(choices) {
  return choices.map(([value, words]) => h("option", { value }, words));
}

/**
 * Replace the choices; the current choice is kept if it is still among them.
 *
 * @param {HTMLSelectElement} list
 * @param {(readonly string[])[]} choices value and words of each
 * @param {string | null} [chosen]
 * @param {string} [otherwise] chosen if it is not
 */
export function offer(list, choices, chosen = list.value, otherwise = choices[0]?.[0]) {
  list.replaceChildren(...options(choices));
  list.value = (choices.some(([value]) => value === chosen) ? chosen : otherwise) ?? "";
}

/**
 * Make an input field without autocompletion.
 *
 * @param {string} type
 * @param {string} id
 * @param {Record<string, unknown>} [attributes]
 */
export function input(type, id, attributes) {
  return h("input", { type, id, autocomplete: "off", ...attributes });
}

/** @param {string} words @param {...Child} children content that opens below the words */
export function details(words, ...children) {
  return h("details", h("summary", words), ...children);
}

/**
 * Make a table that scrolls sideways if it does not fit.
 *
 * @param {string} name its CSS class
 * @param {Child[]} headings of its columns; empty above the column of row headings
 * @param {HTMLElement[]} rows or bodies of rows
 * @param {string} [caption]
 * @param {Record<string, unknown>} [attributes] of the scrolling element
 */
export function table(name, headings, rows, caption, attributes = {}) {
  const heads = headings.map((words) => (words ? h("th", { scope: "col" }, words) : h("td")));
  const content = h(
    "table",
    { class: name || null },
    caption === undefined ? null : h("caption", caption),
    heads.length > 0 ? h("thead", h("tr", ...heads)) : null,
    ...(rows[0]?.localName === "tbody" ? rows : [h("tbody", ...rows)]),
  );
  return h("div.scroll-x", attributes, content);
}

/** @param {Child} heading @param {...Child} values */
export function tableRow(heading, ...values) {
  return h("tr", h("th", { scope: "row" }, heading), ...values.map((value) => h("td", value)));
}

/**
 * Make a list entry: words with controls next to them.
 *
 * @param {Child[]} words
 * @param {...Child} controls
 */
export function item(words, ...controls) {
  return h(
    "li",
    h("div.item-words", ...words),
    controls.length > 0 ? h("div.row", ...controls) : null,
  );
}

/** Make a chip in the colour of a state. @param {string} state @param {string} [words] */
export function stateChip(state, words = state) {
  return h("span.state-chip", { "data-state": state }, words);
}

/**
 * Make the short line that shows a curve's colour and dashes.
 *
 * @param {string} kind of the curve
 * @param {string} colour its name in tokens.css
 */
export function swatch(kind, colour) {
  const line = h("span.swatch.line", { "data-kind": kind, "aria-hidden": "true" });
  return tint(line, colour);
}

/**
 * Set the colour of an element and the swatches in it.
 *
 * @template {HTMLElement} E
 * @param {E} element
 * @param {string | null} colour its name in tokens.css, or #rrggbb; null: none of its own
 */
export function tint(element, colour) {
  element.style.setProperty("--swatch", colour?.startsWith("--") ? `var(${colour})` : colour);
  return element;
}

/**
 * Handle the submission of a form instead of the browser.
 *
 * @param {HTMLFormElement} form
 * @param {() => unknown} act
 */
export function onSubmit(form, act) {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    void act();
  });
}

/**
 * Make an area for choosing or dropping files.
 *
 * @param {HTMLInputElement} file
 * @param {string} words
 * @param {string} help
 * @param {(files: File[]) => unknown} take
 * @param {...Child} more
 */
export function dropZone(file, words, help, take, ...more) {
  const place = h(
    "div.drop",
    h("label", { for: file.id }, icon("upload"), words),
    file,
    h("p.hint", { id: `${file.id}-help` }, help),
    ...more,
  );
  const takeAll = async (/** @type {Iterable<File>} */ files) => {
    await take([...files]);
    // Allow choosing the same file again, once corrected.
    file.value = "";
  };
  file.addEventListener("change", () => void takeAll(file.files ?? []));
  for (const type of ["dragenter", "dragover", "dragleave", "drop"]) {
    place.addEventListener(type, (event) => {
      event.preventDefault();
      place.toggleAttribute("data-over", ["dragenter", "dragover"].includes(type));
    });
  }
  place.addEventListener("drop", (event) => {
    if (!file.disabled) void takeAll(event.dataTransfer?.files ?? []);
  });
  return place;
}

/**
 * Draw an image at its native size.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {ImageBitmap} bitmap closed after drawing
 */
export function paint(canvas, bitmap) {
  const { width, height } = bitmap;
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  canvas.getContext("2d")?.drawImage(bitmap, 0, 0);
  bitmap.close();
}

/** @param {Blob} blob @param {string} name under which the browser saves it */
export function download(blob, name) {
  const href = URL.createObjectURL(blob);
  h("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60_000);
}

/**
 * Make a field: a control under its label, with error and help lines.
 *
 * @param {string} words
 * @param {HTMLElement} control
 * @param {string} [help]
 * @param {...HTMLElement} between
 */
export function field(words, control, help, ...between) {
  const hint = help ? h("p.hint", { id: `${control.id}-help` }, help) : null;
  const said = [control.getAttribute("aria-describedby"), ...between.map(({ id }) => id), hint?.id];
  setAttribute(control, "aria-describedby", said.filter(Boolean).join(" ") || null);
  return h("div.field", h("label", { for: control.id }, words), control, ...between, hint);
}

/**
 * Set the text only if it differs, to avoid needless layout.
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
 * Fill a list with lines of text, rebuilding it only if they differ.
 *
 * @param {HTMLUListElement} list
 * @param {string[]} lines
 */
export function fillList(list, lines) {
  const shown = [...list.children].map(({ textContent }) => textContent);
  if (shown.length === lines.length && lines.every((line, at) => line === shown[at])) return;
  list.replaceChildren(...lines.map((line) => h("li", line)));
}

/**
 * Make one of the page's icons, drawn in the text colour.
 *
 * @param {keyof typeof ICONS} name
 */
export function icon(name) {
  return svg(
    "svg",
    { viewBox: "0 0 16 16", class: "icon", "aria-hidden": "true" },
    svg("path", { d: ICONS[name] }),
  );
}

const ICONS = {
  play: "M4 2.5v11l9-5.5z",
  pause: "M4 2.5h3v11H4zM9 2.5h3v11H9z",
  step: "M3 2.5v11L10 8zM11 2.5h2v11h-2z",
  restart: "M8 3a5 5 0 1 1-4.6 3h1.9A3.3 3.3 0 1 0 8 4.7V7L4 3.8 8 .6z",
  more: "M3 5.5h10L8 11z",
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
  share:
    "M11.5 1.5a2.5 2.5 0 1 1-1.9 4.1L6.4 7.3a2.6 2.6 0 0 1 0 1.4l3.2 1.7a2.5 2.5 0 1 1-.7 1.4L5.7 10.1a2.5 2.5 0 1 1 0-4.2l3.2-1.7a2.5 2.5 0 0 1 2.6-2.7z",
  keys: "M1.5 3.5h13v9h-13zM3 5v1.3h1.5V5zm2.8 0v1.3h1.5V5zm2.9 0v1.3h1.5V5zm2.8 0v1.3H13V5zM3 7.4v1.3h1.5V7.4zm2.8 0v1.3h1.5V7.4zm2.9 0v1.3h1.5V7.4zm2.8 0v1.3H13V7.4zM4.5 9.8v1.3h7V9.8z",
  sun: "M8 5a3 3 0 1 0 0 6 3 3 0 0 0 0-6zM7.3 1h1.4v2.3H7.3zM7.3 12.7h1.4V15H7.3zM1 7.3h2.3v1.4H1zM12.7 7.3H15v1.4h-2.3zM2.6 3.6l1-1 1.6 1.6-1 1zM10.8 11.8l1-1 1.6 1.6-1 1zM2.6 12.4l1.6-1.6 1 1-1.6 1.6zM10.8 4.2l1.6-1.6 1 1-1.6 1.6z",
  moon: "M6.2 1.8A6.5 6.5 0 1 0 14.3 10 5.3 5.3 0 0 1 6.2 1.8z",
  leave:
    "M2.5 2h6v1.6H4.1v8.8h4.4V14h-6zM10.6 4.4 14.2 8l-3.6 3.6-1.1-1.1 1.7-1.7H6.4V7.2h4.8L9.5 5.5z",
  auto: "M8 1.5a6.5 6.5 0 1 0 0 13zM8 1.5v1.3a5.2 5.2 0 0 1 0 10.4v1.3a6.5 6.5 0 0 0 0-13z",
};
