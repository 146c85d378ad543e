/** Short messages that pass, and the question before something is deleted. */

import { button, field, h, icon, input, setAttribute, setText } from "../elements/dom.js";
import { ApiError } from "./api.js";
import { showModal } from "./modal.js";

/** Event of the window for every notice: its detail has `text` and `severity`. */
export const SHOWN = "notice-shown";

const SHOWN_MS = { done: 5000, error: 12000, offer: 12000 };

/**
 * Show one sentence in the page's corner; errors are spoken at once. An error that is told
 * again takes the place of the same one before.
 *
 * @param {string} text
 * @param {"done" | "error"} [kind]
 * @param {{words: string, act: () => void}} [offer] a button beside it, as in Undo
 */
export function notify(text, kind = "done", offer) {
  const host = document.querySelector("#notices");
  if (!host) return;
  const notice = h("p.notice", {
    "data-kind": kind,
    role: kind === "error" ? "alert" : "status",
  });
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
  // Not so what can be undone: each has its own button.
  if (kind === "error") {
    const same = [...host.children].filter((each) => each.firstElementChild?.textContent === text);
    for (const before of same) before.remove();
  }
  host.append(notice);
  const severity = kind === "error" ? "error" : "info";
  window.dispatchEvent(new CustomEvent(SHOWN, { detail: { text, severity } }));
  setTimeout(() => notice.remove(), offer ? SHOWN_MS.offer : SHOWN_MS[kind]);
}

/** @param {unknown} error */
export function notifyError(error) {
  notify(error instanceof Error ? error.message : String(error), "error");
}

/**
 * Do something, and tell what went wrong.
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
 * Do something; where the server refuses it, say why in a place of the page.
 *
 * @param {HTMLElement} place
 * @param {() => unknown} action
 * @returns {Promise<boolean>} whether it was done
 */
export async function attemptIn(place, action) {
  // What was wrong before is taken away; where else is told, it stays until there is news.
  if (place.getAttribute("role") === "alert") refuse(place, "");
  try {
    await action();
    return true;
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    refuse(place, error.message);
    return false;
  }
}

/**
 * Say what is wrong; the fields that the place describes are marked.
 *
 * @param {HTMLElement} place
 * @param {string} message empty takes it away
 */
export function refuse(place, message) {
  setText(place, message);
  const described = place.id && document.querySelectorAll(`[aria-describedby~="${place.id}"]`);
  for (const field of described || []) setAttribute(field, "aria-invalid", message ? "true" : null);
}

/**
 * Do one thing at a time: what is pressed while another goes on is left out, and what went wrong
 * is told.
 *
 * @param {(busy: boolean) => void} [changed] called when something begins and when it has ended
 * @param {HTMLElement | null} [place] says what the server refuses; null: a notice does
 * @returns {(action: () => unknown, teller?: Element, words?: string) => Promise<boolean>} whether
 *   it was done; the teller says the words meanwhile
 */
export function oneAtATime(changed = () => {}, place = null) {
  let busy = false;
  return async (action, teller, words = "") => {
    if (busy) return false;
    busy = true;
    const before = teller?.textContent ?? "";
    if (teller) setText(teller, words);
    changed(busy);
    try {
      return await (place ? attemptIn(place, action) : attempt(action));
    } finally {
      busy = false;
      if (teller) setText(teller, before);
      changed(busy);
    }
  };
}

/**
 * Ask before something that cannot be undone.
 *
 * @param {string} question
 * @param {string} consequence one sentence
 * @param {string} action what the button says
 * @returns {Promise<boolean>}
 */
export async function confirmed(question, consequence, action) {
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
 * @param {string} first what it holds at first
 * @returns {Promise<string | null>} null where it was left
 */
export async function answered(question, label, first) {
  const line = input("text", "answer", { maxlength: 100, required: true, value: first });
  const closed = showModal(
    "question",
    question,
    [field(label, line)],
    h("button.button.primary", { value: "yes" }, "Save"),
    h("button.button", { value: "no", formnovalidate: true }, "Cancel"),
  );
  line.select();
  return (await closed) === "yes" ? line.value.trim() : null;
}
