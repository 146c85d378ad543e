/** Light, dark or the system's theme; remembered in this browser. */

import { h, icon } from "../elements/dom.js";

const KEY = "dynamic-observer.theme";
/** @type {{value: "auto" | "light" | "dark", label: string, icon: "auto" | "sun" | "moon"}[]} */
const CHOICES = [
  { value: "auto", label: "System theme", icon: "auto" },
  { value: "light", label: "Light theme", icon: "sun" },
  { value: "dark", label: "Dark theme", icon: "moon" },
];

class ThemeChoice extends HTMLElement {
  connectedCallback() {
    if (this.childElementCount) return;
    const chosen = loadStored();
    apply(chosen);
    this.append(
      h(
        "fieldset.segmented",
        h("legend.visually-hidden", "Theme"),
        ...CHOICES.map((choice) => {
          const input = h("input", { type: "radio", name: "theme", value: choice.value });
          input.checked = choice.value === chosen;
          input.addEventListener("change", () => {
            localStorage.setItem(KEY, choice.value);
            apply(choice.value);
          });
          const words = h("span.visually-hidden", choice.label);
          return h("label", { title: choice.label }, input, icon(choice.icon), words);
        }),
      ),
    );
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", announce);
  }
}

function loadStored() {
  const value = localStorage.getItem(KEY);
  return value === "light" || value === "dark" ? value : "auto";
}

/** @param {"auto" | "light" | "dark"} theme */
function apply(theme) {
  document.documentElement.dataset.theme = theme;
  announce();
}

/** Canvas drawings read the colours only once; tell them to read these again. */
function announce() {
  window.dispatchEvent(new Event("themechange"));
}

customElements.define("observer-theme-choice", ThemeChoice);
