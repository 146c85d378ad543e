/** Popovers next to a button, which do not shift the page; the "?" next to a name. */

import { button, h } from "../elements/dom.js";

/** @typedef {import("../elements/dom.js").Child} Child */

const GAP_PX = 4;

/**
 * Make the button and the box it opens; the caller inserts both into the page. The described
 * element may refer to the box in `aria-describedby`, which works even while it is closed.
 *
 * @param {string} id of the box
 * @param {string} title what is explained
 * @param {...Child} content
 * @returns {[HTMLButtonElement, HTMLDivElement]}
 */
export function helpButton(id, title, ...content) {
  const box = h("div.pop-box.help-box", { id, popover: true }, ...content);
  const opener = button("?", null, {
    class: "quiet help-button",
    popovertarget: id,
    "aria-label": `About ${title}`,
    title: `About ${title}`,
  });
  openBeside(opener, box);
  return [opener, box];
}

/**
 * Place a popover next to its button each time it opens.
 *
 * @param {HTMLButtonElement} opener
 * @param {HTMLElement} box
 */
export function openBeside(opener, box) {
  const close = (/** @type {Event} */ event) => {
    if (event.target !== box) box.hidePopover();
  };
  // Esc stops the robots except where it only closes something.
  const escape = (/** @type {KeyboardEvent} */ event) => {
    if (event.key !== "Escape") return;
    event.preventDefault();
    box.hidePopover();
  };
  box.addEventListener("beforetoggle", (event) => {
    const opens = /** @type {ToggleEvent} */ (event).newState === "open";
    if (opens) place(box, opener.getBoundingClientRect());
    if (opens) document.addEventListener("keydown", escape);
    else document.removeEventListener("keydown", escape);
    // The box would not follow its button, so close it.
    for (const type of ["scroll", "resize"]) {
      if (opens) window.addEventListener(type, close, true);
      else window.removeEventListener(type, close, true);
    }
  });
}

/**
 * Put a box below or above a button, wherever there is more room.
 *
 * @param {HTMLElement} box
 * @param {DOMRect} beside
 */
function place(box, beside) {
  const { clientWidth: width, clientHeight: height } = document.documentElement;
  const below = beside.top < height / 2;
  box.style.top = below ? `${beside.bottom + GAP_PX}px` : "auto";
  box.style.bottom = below ? "auto" : `${height - beside.top + GAP_PX}px`;
  box.style.right = `${Math.max(GAP_PX, width - beside.right)}px`;
}
