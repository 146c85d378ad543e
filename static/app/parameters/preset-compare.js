/** Compares two presets, or the values in force and a preset, side by side. */

import { h, select, table, tableRow } from "../elements/dom.js";
import { counted } from "../elements/words.js";
import { showModal } from "../shell/modal.js";
import { differences } from "./value-words.js";

/** @import { ParameterEntry, ParameterStore } from "./parameter-store.js" */

const IN_FORCE = "";

/**
 * Open the comparison: at first of the base preset and the current values, or, if nothing was
 * changed, another built-in preset.
 *
 * @param {ParameterStore} store
 */
export async function comparePresets(store) {
  const names = store.presets.map(({ name }) => [name, name]);
  const choices = [[IN_FORCE, "Current values"], ...names];
  const left = select({ id: "compare-left", "aria-label": "First" }, choices);
  const right = select({ id: "compare-right", "aria-label": "Second" }, choices);
  const base = store.basePreset?.name ?? "";
  left.value = base;
  const other = store.presets.find(({ name, built_in: builtIn }) => builtIn && name !== base);
  right.value = store.changed.length > 0 ? IN_FORCE : (other?.name ?? IN_FORCE);
  const announcement = h("p", { role: "status" });
  const found = h("div.preset-differences");
  const show = () => {
    const sides = [left, right].map((list) => ({
      name: list.selectedOptions[0]?.textContent ?? "",
      values: valuesNamed(store, list.value),
    }));
    const rows = differences(
      store.schema,
      sides.map(({ values }) => values),
    );
    announcement.textContent =
      rows.length === 0 ? "All values are the same." : `${counted(rows.length, "value")} differ.`;
    if (rows.length === 1) announcement.textContent = "1 value differs.";
    const headings = ["Parameter", ...sides.map(({ name }) => name)];
    found.replaceChildren(rows.length > 0 ? differenceTable(headings, rows) : "");
  };
  left.addEventListener("change", show);
  right.addEventListener("change", show);
  show();
  await showModal(
    "preview",
    "Compare presets",
    [h("div.row.compared-presets", left, h("span", "and"), right), announcement, found],
    h("button.button", { value: "close" }, "Close"),
  );
}

/**
 * @param {string[]} headings
 * @param {{entry: ParameterEntry, words: string[]}[]} rows
 */
function differenceTable(headings, rows) {
  const lines = rows.map(({ entry, words }) => tableRow(entry.title, ...words));
  return table("settings", headings, lines, undefined, {
    tabindex: 0,
    "aria-label": "Differences",
  });
}

/**
 * @param {ParameterStore} store
 * @param {string} name
 */
function valuesNamed(store, name) {
  return name === IN_FORCE ? store.state.values : store.valuesOf(store.findPreset(name));
}
