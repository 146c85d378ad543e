/** The valid read-only links, in the share dialog: how many watch, and revoking. */

import { button, h, item, setText } from "../elements/dom.js";
import { KeyedList } from "../elements/focus.js";
import { when } from "../elements/words.js";
import { request } from "./api.js";
import { attemptIn, askConfirmation } from "./notice.js";

/** @import { ReadOnlyLinkNow } from "../contract" */

const REFRESH_MS = 2000;

export class RevokeList {
  /** Called when the link to share may have changed. @type {() => Promise<void>} */
  changed = async () => {};

  #make = button("New link", () => this.#act(() => request("POST", "/links/read-only", {})), {
    title: "Existing links remain valid",
  });
  #list = h("ul.item-list");
  #items = new KeyedList(
    this.#list,
    (/** @type {ReadOnlyLinkNow} */ link) => this.#item(link),
    () => this.#make,
  );
  #error = h("p.field-error", { role: "alert" });
  #status = h("span.visually-hidden", { role: "status" });
  element = h(
    "section.share-links",
    { "aria-label": "Read-only links" },
    h("div.pane-head.row", h("h3", "Read-only links"), this.#make),
    this.#list,
    this.#error,
    this.#status,
  );
  #timer = 0;

  async begin() {
    await this.#load();
    this.#timer = setInterval(() => void this.#load().catch(() => {}), REFRESH_MS);
  }

  end() {
    clearInterval(this.#timer);
  }

  async #load() {
    /** @type {ReadOnlyLinkNow[]} */
    const links = await request("GET", "/links/read-only");
    this.#items.show(links, ({ id }) => id);
  }

  /** @param {ReadOnlyLinkNow} link */
  #item(link) {
    const made = when(link.made_at);
    const revoke = button("Revoke", () => this.#revoke(link), {
      "aria-label": `Revoke the link created ${made}`,
    });
    const words = [`Created ${made}`, link.shared ? " (the link above)" : ""];
    return item([h("p", ...words), h("p.hint", watchingInWords(link.watching))], revoke);
  }

  /** @param {ReadOnlyLinkNow} link */
  async #revoke({ id, made_at, watching }) {
    const them = watching === 1 ? "1 browser is" : `${watching} browsers are`;
    const sure = await askConfirmation(
      `Revoke the link created ${when(made_at)}?`,
      `Nobody can open it any more${watching > 0 ? `, and ${them} signed out at once` : ""}. You cannot undo this.`,
      "Revoke link",
    );
    if (sure && (await this.#act(() => request("DELETE", `/links/read-only/${id}`))))
      setText(this.#status, "Link revoked.");
  }

  /** @param {() => Promise<unknown>} act */
  #act(act) {
    setText(this.#status, "");
    return attemptIn(this.#error, async () => {
      await act();
      await Promise.all([this.#load(), this.changed()]);
    });
  }
}

/** @param {number} watching */
function watchingInWords(watching) {
  if (watching === 0) return "Nobody is watching";
  return watching === 1 ? "1 browser is watching" : `${watching} browsers are watching`;
}
