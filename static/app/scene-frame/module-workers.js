/**
 * Lets module workers start in the viewer's page, which has no origin.
 *
 * viser's client creates its workers as modules from blobs. In a page without an origin Chromium
 * does not load these, but does load the same text from a `data:` URL. A classic script: it must
 * run before the client's, and a module would run later.
 */

"use strict";

{
  /** @param {string | URL} blob @returns {string} the same text as a `data:` URL */
  const dataAddress = (blob) => {
    // Synchronous, as a constructor cannot wait; the blob is in this process.
    const request = new XMLHttpRequest();
    request.open("GET", blob, false);
    request.send();
    return `data:text/javascript;charset=utf-8,${encodeURIComponent(request.responseText)}`;
  };

  window.Worker = class extends Worker {
    /** @param {string | URL} address @param {WorkerOptions} [options] */
    constructor(address, options) {
      const fromBlob = options?.type === "module" && String(address).startsWith("blob:");
      super(fromBlob ? dataAddress(address) : address, options);
    }
  };
}
