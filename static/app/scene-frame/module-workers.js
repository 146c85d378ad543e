/**
 * Has workers that are modules start in the viewer's page, which has no origin.
 *
 * viser's client makes its workers as modules from a blob. Chromium loads no such module where the
 * page has no origin, but the same text from a `data:` address. A classic script: it must run before
 * the client's, and modules would be later.
 */

"use strict";

{
  /** @param {string | URL} blob @returns {string} the same text as an address of its own */
  const dataAddress = (blob) => {
    // A constructor cannot wait; the blob is in this process.
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
