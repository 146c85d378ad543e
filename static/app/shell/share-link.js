/** Links to share this server with others, also as a QR code for a phone. */

import { button, field, h, icon, input, offer, select, setText } from "../elements/dom.js";
import { RevokeList } from "./revoke-list.js";
import { request } from "./api.js";
import { access } from "./access.js";
import { showModal } from "./modal.js";
import { attempt } from "./notice.js";

/** @import { ShareLinks } from "../contract" */

/** @type {{value: ShareLinks["access"], label: string, help: string}[]} */
const CHOICES = [
  {
    value: "read_only",
    label: "Read-only",
    help: "Anyone with this link can see everything and stop the robots, but cannot change anything.",
  },
  {
    value: "operator",
    label: "Operator",
    help: "Anyone with this link can change everything and drive. Treat it like a password.",
  },
];

class Share extends HTMLElement {
  connectedCallback() {
    if (this.childElementCount) return;
    this.append(
      button([icon("share"), h("span", "Share")], () => attempt(() => this.#open()), {
        title: "Links and a QR code for others",
      }),
    );
  }

  async #open() {
    const mayRevoke = (await access()) === "operator";
    const offered = mayRevoke ? CHOICES : CHOICES.slice(0, 1);
    const ask = () =>
      Promise.all(
        offered.map(({ value }) =>
          request("GET", `/links?access=${value}`).then(
            (answer) => /** @type {ShareLinks} */ (answer),
          ),
        ),
      );
    const revoking = mayRevoke ? new RevokeList() : null;
    const { content, take } = sharing(offered, await ask(), revoking);
    if (revoking) {
      revoking.changed = async () => take(await ask());
      await revoking.begin();
    }
    await showModal(
      "question",
      "Share this page",
      content,
      h("button.button", { value: "" }, "Close"),
    );
    revoking?.end();
  }
}

/**
 * Make the dialog's content, which follows the choices in it.
 *
 * @param {typeof CHOICES} offered
 * @param {ShareLinks[]} lists of each choice
 * @param {RevokeList | null} revoking
 * @returns {{content: HTMLElement[], take: (lists: ShareLinks[]) => void}} take shows other links
 */
function sharing(offered, lists, revoking) {
  let drawn = 0;
  const help = h("p.hint", { id: "share-help" });
  const address = select({ id: "share-address" }, []);
  const code = h("img.share-code", { alt: "QR code of the link", width: 208, height: 208 });
  const link = input("text", "share-link", { readonly: true, spellcheck: false });
  const copied = h("span.visually-hidden", { role: "status" });
  const copy = button("Copy", async () => {
    const done = await copyText(link);
    setText(copied, done ? "Copied" : "");
    setText(copy, done ? "Copied" : "Copy");
  });
  const note = h("p.hint", lists[0]?.note ?? "");
  note.hidden = note.textContent === "";

  const radios = offered.map(({ value }, at) => {
    const radio = h("input", { type: "radio", name: "share-access", value, checked: at === 0 });
    radio.addEventListener("change", () => show());
    return radio;
  });
  const show = () => {
    const at = Math.max(
      0,
      radios.findIndex((radio) => radio.checked),
    );
    const { access, links } = lists[at] ?? { access: "read_only", links: [] };
    setText(help, offered[at]?.help ?? "");
    if (revoking) revoking.element.hidden = access !== "read_only";
    offer(
      address,
      links.map((each, index) => [
        String(index),
        each.here ? `${each.address} (this computer)` : each.address,
      ]),
    );
    const chosen = Number(address.value);
    link.value = links[chosen]?.link ?? "";
    // A phone cannot open an address that works only on this computer.
    code.hidden = links[chosen]?.here ?? true;
    // A new address each time, as otherwise the browser would show a cached image.
    drawn += 1;
    if (!code.hidden) code.src = `/api/links/qr.svg?access=${access}&link=${chosen}&n=${drawn}`;
    setText(copy, "Copy");
  };
  address.addEventListener("change", show);
  link.addEventListener("focus", () => link.select());
  show();
  const content = [
    h(
      "fieldset.share-choice",
      { "aria-describedby": help.id },
      h("legend", "Access"),
      ...radios.map((radio, at) => h("label", radio, offered[at]?.label)),
    ),
    help,
    field("Address", address),
    code,
    h("div.field", h("label", { for: link.id }, "Link"), h("div.row.share-copy", link, copy)),
    copied,
    note,
    ...(revoking ? [revoking.element] : []),
  ];
  const take = (/** @type {ShareLinks[]} */ others) => {
    lists = others;
    show();
  };
  return { content, take };
}

/**
 * Copy a field's text, even if the page came unencrypted and so has no clipboard access.
 *
 * @param {HTMLInputElement} from
 */
async function copyText(from) {
  try {
    await navigator.clipboard.writeText(from.value);
    return true;
  } catch {
    from.select();
    return document.execCommand("copy");
  }
}

customElements.define("observer-share", Share);
