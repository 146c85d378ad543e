import assert from "node:assert/strict";
import { test } from "node:test";

import "../fake-page.mjs";
import { parameter } from "../made.mjs";

/** @import { Values } from "../../../static/app/parameters/parameter-store.js" */

const { ParameterField } = await import("../../../static/app/parameters/parameter-field.js");

const NAME = "flow.window_px";
const ENTRY = parameter({ name: NAME });

/** A field that shows 15, its text, and what it has sent. */
function shown() {
  /** @type {Values[]} */
  const sent = [];
  const field = new ParameterField();
  field.build(ENTRY, {
    defaults: { [NAME]: 15 },
    change: async () => {},
    changeUndoably: async (changes) => void sent.push(changes),
  });
  field.show(15, "affine");
  const text = [...field.querySelectorAll("input")].find((each) => each.id !== "");
  if (!text) throw new Error("no text field");
  const type = (/** @type {string} */ value) => {
    text.value = value;
    text.dispatchEvent(new Event("input"));
  };
  return { field, text, type, sent };
}

test("a value changed elsewhere does not replace what is being typed", () => {
  const { field, text, type, sent } = shown();
  type("1");
  field.show(21, "affine");
  assert.equal(text.value, "1");
  type("17");
  text.dispatchEvent(new Event("change"));
  text.dispatchEvent(new Event("blur"));
  assert.deepEqual(sent, [{ [NAME]: 17 }]);
  // Not reset before the answer arrives.
  assert.equal(text.value, "17");
});

test("a refused edit is reset, and so is one taken back", () => {
  const { field, text, type } = shown();
  type("99");
  text.dispatchEvent(new Event("change"));
  field.show(15, "affine");
  assert.equal(text.value, "15");
  type("1");
  field.show(21, "affine");
  // A browser calls this no change: the text is what it was at first.
  type("15");
  text.dispatchEvent(new Event("blur"));
  assert.equal(text.value, "21");
});

test("an edit goes on while another window has the focus", () => {
  const { field, text, type } = shown();
  type("1");
  Object.assign(document, { activeElement: text });
  text.dispatchEvent(new Event("blur"));
  field.show(21, "affine");
  assert.equal(text.value, "1");
  Object.assign(document, { activeElement: null });
});
