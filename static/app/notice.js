/** Short messages that pass, and the question before something is deleted. */

import { h, icon } from "./dom.js";
import { showModal } from "./driving/modal.js";

const SHOWN_MS = { done: 5000, error: 12000, offer: 12000 };

/**
 * Show one sentence in the page's corner; errors are spoken at once.
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
  const close = h(
    "button.quiet",
    { type: "button", "aria-label": "Close this message" },
    icon("close"),
  );
  close.addEventListener("click", () => notice.remove());
  const button = offer ? h("button.quiet.offer", { type: "button" }, offer.words) : null;
  button?.addEventListener("click", () => {
    notice.remove();
    offer?.act();
  });
  notice.append(h("span", text), ...(button ? [button] : []), close);
  host.append(notice);
  setTimeout(() => notice.remove(), offer ? SHOWN_MS.offer : SHOWN_MS[kind]);
}

/** @param {unknown} error */
export function notifyError(error) {
  notify(error instanceof Error ? error.message : String(error), "error");
}

/**
 * Ask before something that cannot be undone.
 *
 * @param {string} question
 * @param {string} consequence one sentence
 * @param {string} action what the button says
 * @returns {Promise<boolean>}
 */
export function confirmed(question, consequence, action) {
  return new Promise((resolve) => {
    const dialog = h(
      "dialog.question",
      { "aria-labelledby": "question-title" },
      h(
        "form",
        { method: "dialog" },
        h("h2", { id: "question-title" }, question),
        h("p", consequence),
        h(
          "div.row.end",
          h("button.button", { value: "no" }, "Keep"),
          h("button.button.danger", { value: "yes" }, action),
        ),
      ),
    );
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue === "yes");
    });
    document.body.append(dialog);
    showModal(dialog);
  });
}

/**
 * Ask for a line of text.
 *
 * @param {string} question
 * @param {string} label of the field
 * @param {string} first what it holds at first
 * @returns {Promise<string | null>} null where it was left
 */
export function answered(question, label, first) {
  const input = h("input", {
    type: "text",
    id: "answer",
    maxlength: 100,
    required: true,
    autocomplete: "off",
  });
  input.value = first;
  const dialog = h(
    "dialog.question",
    { "aria-labelledby": "answer-title" },
    h(
      "form",
      { method: "dialog" },
      h("h2", { id: "answer-title" }, question),
      h("div.field", h("label", { for: "answer" }, label), input),
      h(
        "div.row.end",
        h("button.button.primary", { value: "yes" }, "Take it"),
        h("button.button", { value: "no", formnovalidate: true }, "Leave"),
      ),
    ),
  );
  document.body.append(dialog);
  showModal(dialog);
  input.select();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue === "yes" ? input.value.trim() : null);
    });
  });
}
