/** Transient notices, confirmations and prompts, and reporting errors of actions. */

import { button, field, h, icon, input, setAttribute, setText } from "../elements/dom.js";
import { Aborted, ApiError } from "./api.js";
import { showModal } from "./modal.js";

/** Event of the window for every notice: its detail has `text` and `severity`. */
export const NOTICE_SHOWN = "notice-shown";

// More would cover the page, on a phone also the stop button. The log has them all.
const MAX_SHOWN = 3;
const SHOWN_MS = { done: 5000, error: 12000, offer: 12000 };

/**
 * Show one sentence in the corner of the page; errors are announced at once. A repeated error
 * replaces its previous notice.
 *
 * @param {string} text
 * @param {"done" | "error"} [kind]
 * @param {{words: string, act: () => void}} [offer] a button next to it, such as Undo
 */
export function notify(text, kind = "done", offer) {
  const host = document.querySelector("#notices");
  if (!host) return;
  const notice = h("p.notice", {
    "data-kind": kind,
    role: kind === "error" ? "alert" : "status",
  });
  notice.toggleAttribute("data-offer", offer !== undefined);
  const close = button(icon("close"), () => notice.remove(), {
    class: "quiet",
    "aria-label": "Dismiss message",
  });
  const taken = () => {
    notice.remove();
    offer?.act();
  };
  notice.append(
    h("span", text),
    offer ? button(offer.words, taken, { class: "quiet offer" }) : "",
    close,
  );
  // Notices with an offer are not merged: each has its own button.
  if (kind === "error") {
    const same = [...host.children].filter((each) => each.firstElementChild?.textContent === text);
    for (const before of same) before.remove();
  }
  host.append(notice);
  while (host.childElementCount > MAX_SHOWN) {
    // An offer cannot be had again: those without one give way first.
    const before = [...host.children].filter((each) => each !== notice);
    (before.find((each) => !each.hasAttribute("data-offer")) ?? before[0])?.remove();
  }
  const severity = kind === "error" ? "error" : "info";
  window.dispatchEvent(new CustomEvent(NOTICE_SHOWN, { detail: { text, severity } }));
  setTimeout(() => notice.remove(), offer ? SHOWN_MS.offer : SHOWN_MS[kind]);
}

/** Show why something failed. @param {unknown} error */
export function notifyError(error) {
  if (error instanceof Aborted) return;
  notify(error instanceof Error ? error.message : String(error), "error");
}

/**
 * Do something and show a notice if it fails.
 *
 * @param {() => unknown} action
 * @returns {Promise<boolean>} whether it was done
 */
export async function attempt(action) {
  try {
    await action();
    return true;
  } catch (error) {
    notifyError(error);
    return false;
  }
}

/**
 * Do something; if the server refuses it, say why in an element of the page.
 *
 * @param {HTMLElement} place
 * @param {() => unknown} action
 * @returns {Promise<boolean>} whether it was done
 */
export async function attemptIn(place, action) {
  // Clear an earlier error; other words in the element stay until there are new ones.
  if (place.getAttribute("role") === "alert") showError(place, "");
  try {
    await action();
    return true;
  } catch (error) {
    if (error instanceof ApiError) showError(place, error.message);
    else if (!(error instanceof Aborted)) throw error;
    return false;
  }
}

/**
 * Say what is wrong, and mark the fields that the element describes.
 *
 * @param {HTMLElement} place
 * @param {string} message empty clears it
 */
export function showError(place, message) {
  setText(place, message);
  const described = place.id && document.querySelectorAll(`[aria-describedby~="${place.id}"]`);
  for (const field of described || []) setAttribute(field, "aria-invalid", message ? "true" : null);
}

/**
 * Return a function that does one thing at a time, ignores calls while busy, and reports errors.
 *
 * @param {(busy: boolean) => void} [changed] called when an action begins and when it has ended
 * @param {HTMLElement | null} [place] shows refusals of the server; null: a notice does
 * @returns {(action: () => unknown, indicator?: Element, words?: string) => Promise<boolean>} whether
 *   it was done; the indicator shows the words meanwhile
 */
export function exclusiveRunner(changed = () => {}, place = null) {
  let busy = false;
  return async (action, indicator, words = "") => {
    if (busy) return false;
    busy = true;
    const before = indicator?.textContent ?? "";
    if (indicator) setText(indicator, words);
    changed(busy);
    try {
      return await (place ? attemptIn(place, action) : attempt(action));
    } finally {
      busy = false;
      if (indicator) setText(indicator, before);
      changed(busy);
    }
  };
}

/**
 * Ask before something that cannot be undone.
 *
 * @param {string} question
 * @param {string} consequence one sentence
 * @param {string} action label of the button
 * @returns {Promise<boolean>}
 */
export async function askConfirmation(question, consequence, action) {
  const answer = await showModal(
    "question",
    question,
    [h("p", consequence)],
    h("button.button", { value: "no" }, "Cancel"),
    h("button.button.danger", { value: "yes" }, action),
  );
  return answer === "yes";
}

/**
 * Ask for a line of text.
 *
 * @param {string} question
 * @param {string} label of the field
 * @param {string} first initial value
 * @returns {Promise<string | null>} null if cancelled
 */
export async function promptText(question, label, first) {
  const line = input("text", "answer", { maxlength: 100, required: true, value: first });
  // Not a submit button: Enter in the field would press the first of them.
  const cancel = button("Cancel", () => cancel.closest("dialog")?.close());
  const closed = showModal(
    "question",
    question,
    [field(label, line)],
    cancel,
    h("button.button.primary", { value: "yes" }, "Save"),
  );
  line.select();
  return (await closed) === "yes" ? line.value.trim() : null;
}
