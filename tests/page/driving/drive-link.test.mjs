import assert from "node:assert/strict";
import { mock, test } from "node:test";

const RETRY_MS = 250;

/** Addresses of the sockets opened. @type {string[]} */
const opened = [];
/** The newest one. @type {EventTarget | null} */
let socket = null;
/** The operator's name in the browser's storage. @type {string | null} */
let name = null;

class FakeSocket extends EventTarget {
  /** @param {string} address */
  constructor(address) {
    super();
    opened.push(address);
    socket = this;
  }

  send() {}
}

const window = new EventTarget();
mock.timers.enable({ apis: ["setInterval", "setTimeout"] });
Object.assign(globalThis, {
  window,
  location: { protocol: "http:", host: "here" },
  localStorage: { getItem: () => name, setItem: () => {} },
  WebSocket: FakeSocket,
});
const { DriveLink } = await import("../../../static/app/driving/drive-link.js");
const link = new DriveLink();

test("nothing connects before an operator takes control", () => {
  window.dispatchEvent(new Event("online"));
  assert.deepEqual(opened, []);
});

test("every connection carries the operator's present name", () => {
  name = "Ada";
  void link.take("observer", false);
  assert.deepEqual(opened.splice(0), ["ws://here/api/drive?name=Ada"]);
  socket?.dispatchEvent(new Event("open"));
  name = "Grace H";
  socket?.dispatchEvent(Object.assign(new Event("close"), { code: 1006 }));
  mock.timers.tick(RETRY_MS);
  assert.deepEqual(opened.splice(0), ["ws://here/api/drive?name=Grace%20H"]);
});

test("a browser that is online again does not wait to reconnect", () => {
  socket?.dispatchEvent(new Event("open"));
  socket?.dispatchEvent(Object.assign(new Event("close"), { code: 1006 }));
  window.dispatchEvent(new Event("online"));
  assert.equal(opened.length, 1);
});
