/**
 * Leaves processor time to others where 3D is drawn slowly (no GPU): the window's animation pauses
 * after every slow drawing. Fires `drawn` on the window after each one.
 *
 * A classic script: it must run before the client's, which would otherwise cancel callbacks by the
 * browser's ids while they wait here under ours.
 */

"use strict";

{
  // Drawings faster than this are not delayed.
  const SLOW_MS = 40;
  // After a slow drawing, pause for this many times its duration: page and server share the
  // processor.
  const PAUSE_RATIO = 5;
  // While the user turns the scene, smooth turning matters more than fresh data.
  const PAUSE_RATIO_INTERACTING = 1;
  const INTERACTING_MS = 1000;
  const MAX_PAUSE_MS = 1000;

  const ask = window.requestAnimationFrame.bind(window);
  /** @type {Map<number, FrameRequestCallback>} */
  const waiting = new Map();
  let number = 0;
  let asked = false;
  let pause_ms = 0;
  let touched = -INTERACTING_MS;

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
    const ratio = now - touched < INTERACTING_MS ? PAUSE_RATIO_INTERACTING : PAUSE_RATIO;
    pause_ms = took > SLOW_MS ? Math.min(ratio * took, MAX_PAUSE_MS) : 0;
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
      if (pause_ms > 0) setTimeout(() => ask(draw), pause_ms);
      else ask(draw);
    }
    return number;
  };
  window.cancelAnimationFrame = (id) => void waiting.delete(id);
}
