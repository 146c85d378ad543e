/** One live view: JPEG images over a WebSocket, each acknowledged when it has been shown. */

import { socketUrl } from "../shell/live-socket.js";

const HEADER_BYTES = 16;
const RETRY_MS = 1000;

/**
 * @typedef {object} ViewImage
 * @property {ImageBitmap} bitmap to be drawn, then closed
 * @property {number} ageMs since the pair was received, when the server sent it
 */

export class ViewSocket {
  /** @type {WebSocket | null} */
  #socket = null;
  #wanted = false;
  #retry = 0;

  /**
   * @param {string} name of the view
   * @param {(image: ViewImage) => void} show called with each image from the open socket
   */
  constructor(name, show) {
    this.url = socketUrl(`/api/views/${encodeURIComponent(name)}`);
    this.show = show;
  }

  open() {
    this.#wanted = true;
    if (this.#socket) return;
    clearTimeout(this.#retry);
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    socket.addEventListener("message", (event) => void this.#receive(socket, event.data));
    socket.addEventListener("close", () => {
      if (this.#socket !== socket) return;
      this.#socket = null;
      if (this.#wanted) this.#retry = setTimeout(() => this.open(), RETRY_MS);
    });
  }

  close() {
    this.#wanted = false;
    clearTimeout(this.#retry);
    const socket = this.#socket;
    this.#socket = null;
    socket?.close();
  }

  /**
   * @param {WebSocket} socket
   * @param {unknown} data 8 bytes sequence, float64 age in ms (both big-endian), then JPEG
   */
  async #receive(socket, data) {
    if (data instanceof ArrayBuffer && data.byteLength > HEADER_BYTES) {
      const ageMs = new DataView(data).getFloat64(8);
      const jpeg = new Blob([new Uint8Array(data, HEADER_BYTES)], { type: "image/jpeg" });
      // An image that cannot be decoded is skipped; the acknowledgement asks for the next one.
      const bitmap = await createImageBitmap(jpeg).catch(() => null);
      if (bitmap && this.#socket === socket) this.show({ bitmap, ageMs });
      else bitmap?.close();
    }
    if (socket.readyState === WebSocket.OPEN) socket.send("ack");
  }
}
