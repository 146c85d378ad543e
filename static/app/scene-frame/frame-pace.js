/**
 * Leaves processor time to the others where 3D is drawn slowly (no GPU): the window's animation waits
 * after every slow drawing. Tells `drawn` of the window after each.
 *
 * A classic script: it must run before the client's, which would otherwise cancel by the browser's
 * numbers what waits here by ours.
 */

"use strict";

{
  // A drawing within this is left alone.
  const SLOW_MS = 40;
  // After a slow one, nothing is drawn for so many times its duration: page and server share the
  // processor with it.
  const REST_SHARE = 5;
  // Somebody who turns the scene wants to see it turn, and bears later data meanwhile.
  const REST_SHARE_IN_HAND = 1;
  const IN_HAND_MS = 1000;
  const LONGEST_REST_MS = 1000;

  const ask = window.requestAnimationFrame.bind(window);
  /** @type {Map<number, FrameRequestCallback>} */
  const waiting = new Map();
  let number = 0;
  let asked = false;
  let rest_ms = 0;
  let touched = -IN_HAND_MS;

  for (const kind of ["pointerdown", "pointermove", "wheel", "keydown"]) {
    const touch = (/** @type {Event} */ event) => {
      const hovers = event instanceof PointerEvent && event.buttons === 0;
      if (!hovers) touched = performance.now();
    };
    window.addEventListener(kind, touch, { capture: true, passive: true });
  }

  const measure = (/** @type {number} */ start) => {
    const now = performance.now();
    const took = now - start;
    const share = now - touched < IN_HAND_MS ? REST_SHARE_IN_HAND : REST_SHARE;
    rest_ms = took > SLOW_MS ? Math.min(share * took, LONGEST_REST_MS) : 0;
    window.dispatchEvent(new Event("drawn"));
  };

  const draw = (/** @type {number} */ time) => {
    asked = false;
    const start = performance.now();
    const due = [...waiting.values()];
    waiting.clear();
    for (const callback of due) {
      try {
        callback(time);
      } catch (error) {
        window.reportError(error);
      }
    }
    ask(() => measure(start));
  };

  window.requestAnimationFrame = (callback) => {
    number += 1;
    waiting.set(number, callback);
    if (!asked) {
      asked = true;
      if (rest_ms > 0) setTimeout(() => ask(draw), rest_ms);
      else ask(draw);
    }
    return number;
  };
  window.cancelAnimationFrame = (id) => void waiting.delete(id);
}
