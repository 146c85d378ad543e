/**
 * Makes viser's client reconnect after losing its link to the server. By itself it does so only
 * while the frame has the focus, which is usually on the outer page.
 *
 * A classic script: it must run before the client's, which starts the worker that holds the link.
 */

"use strict";

{
  const RETRY_MS = 1000;
  // A link silent for this long may be dead without having been closed.
  const SILENT_MS = 3000;

  /** @type {Worker | null} */
  let link = null;
  let open = false;
  let lastMessageAt = 0;

  const connect = () => link?.postMessage({ type: "retry" });

  /** @param {Worker} worker @param {{type?: string, versionMismatch?: boolean} | null} message */
  const handleMessage = (worker, message) => {
    if (message?.type === "connected" || message?.type === "message_batch") {
      link = worker;
      open = true;
      lastMessageAt = performance.now();
    } else if (message?.type === "closed") {
      link = worker;
      open = false;
      // A server of another version brings its own client.
      const again = message.versionMismatch ? () => location.reload() : connect;
      setTimeout(() => !open && again(), RETRY_MS);
    }
  };

  window.Worker = class extends Worker {
    /** @param {string | URL} address @param {WorkerOptions} [options] */
    constructor(address, options) {
      super(address, options);
      this.addEventListener("message", ({ data }) => handleMessage(this, data));
    }
  };

  window.addEventListener("message", ({ source, data }) => {
    const back = source === parent && data?.kind === "back";
    if (back && open && performance.now() - lastMessageAt > SILENT_MS) connect();
  });
}
