/** Saved clips of half a minute: played as a source, downloaded, deleted. */

import { button, downloadLink, h, icon, iconButton, item } from "../elements/dom.js";
import { KeyedList } from "../elements/focus.js";
import { Part } from "../elements/part.js";
import { when } from "../elements/words.js";
import { request } from "../shell/api.js";
import { attempt, askConfirmation, notify } from "../shell/notice.js";
import { runHref, size } from "./run-words.js";

/** @import { ClipEntry } from "../contract" */

export class SavedClipList extends Part {
  /** Called once a clip has been opened as a source. @type {() => void} */
  left = () => {};

  #heading = h("h3", { tabindex: "-1" }, "Saved clips");
  #list = h("ul.item-list");
  #items = new KeyedList(
    this.#list,
    (/** @type {ClipEntry} */ clip) => this.#item(clip),
    () => this.#heading,
  );
  #shown = false;

  build() {
    this.hidden = true;
    this.append(this.#heading, this.#list);
    this.listen("saved-clips runs reconnected", () => this.#load());
  }

  /** @param {boolean} shown */
  show(shown) {
    this.#shown = shown;
    if (shown) void this.#load();
    else this.hidden = true;
  }

  async #load() {
    if (!this.#shown) return;
    /** @type {ClipEntry[] | null} */
    const clips = await request("GET", "/recording/clips").catch(() => null);
    if (!clips) return;
    this.hidden = !this.#shown || (clips.length === 0 && !this.contains(document.activeElement));
    this.#items.show(clips, ({ name }) => name);
  }

  /** @param {ClipEntry} clip */
  #item(clip) {
    const { name, run_id: run, bytes } = clip;
    const at = when(clip.saved_at);
    const play = button([icon("play"), "Play"], () => this.#open(clip), {
      "aria-label": `Play the clip that ends at ${at}`,
    });
    const remove = iconButton(
      "trash",
      `Delete the clip that ends at ${at}`,
      () => this.#delete(clip),
      { title: "Delete" },
    );
    return item(
      [
        h("p", `Ends at ${at}`),
        h(
          "p.hint",
          size(bytes),
          run && ", ",
          run && h("a", { href: runHref(run) }, "from this run"),
        ),
      ],
      play,
      downloadLink("MCAP", {
        href: `/api/recording/clips/${encodeURIComponent(name)}`,
        download: `${name}.mcap`,
        "aria-label": `Download the clip that ends at ${at}`,
      }),
      remove,
    );
  }

  /** @param {ClipEntry} clip */
  async #open(clip) {
    await attempt(async () => {
      this.hub.applyStatus(await request("PUT", "/source", { source: clip.source }));
      notify(`Playing the clip that ends at ${when(clip.saved_at)}.`);
      this.left();
    });
  }

  /** @param {ClipEntry} clip */
  async #delete(clip) {
    const sure = await askConfirmation(
      `Delete the clip that ends at ${when(clip.saved_at)}?`,
      "You cannot undo this.",
      "Delete clip",
    );
    if (!sure) return;
    await attempt(() => request("DELETE", `/recording/clips/${encodeURIComponent(clip.name)}`));
    await this.#load();
  }
}

customElements.define("observer-saved-clips", SavedClipList);
