import assert from "node:assert/strict";
import { test } from "node:test";

import { LogBook } from "../../../static/app/shell/log-book.js";

/** @param {number} number @param {string} text @returns {any} */
const entry = (number, text = `entry ${number}`) => ({
  number,
  time: 1000 + number,
  severity: "info",
  text,
});
/** @param {LogBook} book */
const texts = (book) => book.lines().map(({ text }) => text);

test("what is told is added once, and what was missed is noticed", () => {
  const book = new LogBook();
  book.replace([entry(1), entry(2)]);
  assert.ok(book.add([entry(2), entry(3)]));
  assert.ok(book.add([entry(3)]));
  assert.deepEqual(texts(book), ["entry 1", "entry 2", "entry 3"]);
  assert.equal(book.add([entry(5)]), false);
  assert.equal(texts(book).length, 3);
});

test("a server that was started again replaces everything", () => {
  const book = new LogBook();
  book.replace([entry(1), entry(2)]);
  book.replace([entry(1, "Server started.")]);
  assert.deepEqual(texts(book), ["Server started."]);
});

test("as many are kept as the server keeps", () => {
  const book = new LogBook();
  for (let number = 1; number <= 700; number++) assert.ok(book.add([entry(number)]));
  assert.equal(texts(book).length, 500);
  assert.equal(texts(book)[0], "entry 201");
});

test("the page's notices stand between the server's, but no refusal twice", () => {
  const book = new LogBook();
  book.replace([entry(1), entry(5, "Refused: the run first is going; stop it.")]);
  book.note("Link copied.", "info", 1003);
  book.note("The run first is going; stop it.", "error", 1005.4);
  assert.deepEqual(texts(book), [
    "entry 1",
    "Link copied.",
    "Refused: the run first is going; stop it.",
  ]);
  assert.match(book.text(), /^1970-01-01T00:16:41.000Z INFO entry 1\n/);
});
