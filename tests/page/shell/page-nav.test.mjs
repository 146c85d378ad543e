import assert from "node:assert/strict";
import { test } from "node:test";

import { FakeElement, partOf } from "../fake-page.mjs";

const { viewAt } = await import("../../../static/app/shell/page-nav.js");

test("in a narrow window the menu leads to every page, and the first tab says what it shows", () => {
  const list = new FakeElement("nav");
  const menu = new FakeElement("div");
  menu.append(list);
  const tab = new FakeElement("button");
  const found = { "#page-menu": menu };
  Object.assign(document, {
    querySelector: (/** @type {"#page-menu"} */ selector) => found[selector] ?? null,
    getElementById: () => tab,
  });
  const nav = partOf("observer-page-nav");
  nav.attach(new EventTarget());
  const current = () =>
    list.children.filter((link) => link.getAttribute("aria-current")).map((a) => a.textContent);
  assert.deepEqual(
    list.children.map((link) => link.getAttribute("href")),
    ["#live", "#runs", "#steps"],
  );
  assert.deepEqual([current(), tab.textContent], [["Live"], "View"]);
  document.body.setAttribute("data-away", "");
  location.hash = "#steps/4?source=simulated:lab";
  nav.hub.dispatchEvent(new Event("page"));
  assert.deepEqual([current(), tab.textContent], [["Method"], "Method"]);
  // Comparing methods is not one of these pages; its link beside the switch says where one is.
  location.hash = "#methods";
  nav.hub.dispatchEvent(new Event("page"));
  assert.deepEqual([current(), tab.textContent], [[], "Compare"]);
});

test("the first tab has the name of the view", () => {
  const names = ["#runs", "#runs/r1", "#runs/compare/r1,r2", "#methods", "#live"];
  assert.deepEqual(names.map(viewAt), ["All runs", "Run", "Compare", "Compare", "View"]);
});
