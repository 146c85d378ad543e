/** Leaves processor time to the others where 3D is drawn slowly (no GPU). */

// A drawing within this is left alone.
const SLOW_MS = 40;
// After a slow one, nothing is drawn for so many times its duration: page and server share the
// processor with it.
const REST_SHARE = 5;
// Somebody who turns the scene wants to see it turn, and bears later data meanwhile.
const REST_SHARE_IN_HAND = 1;
const IN_HAND_MS = 1000;
const LONGEST_REST_MS = 1000;

/**
 * Have a window's animation wait after every slow drawing.
 *
 * @param {Window & typeof globalThis} inside
 * @param {() => void} drawn called after every drawing
 */
export function paceFrames(inside, drawn) {
  const ask = inside.requestAnimationFrame.bind(inside);
  /** @type {Map<number, FrameRequestCallback>} */
  const waiting = new Map();
  let number = 0;
  let asked = false;
  let rest_ms = 0;
  let touched = -IN_HAND_MS;

  for (const kind of ["pointerdown", "pointermove", "wheel", "keydown"]) {
    const touch = (/** @type {Event} */ event) => {
      const hovers = event instanceof inside.PointerEvent && event.buttons === 0;
      if (!hovers) touched = performance.now();
    };
    inside.addEventListener(kind, touch, { capture: true, passive: true });
  }

  const measure = (/** @type {number} */ start) => {
    const now = performance.now();
    const took = now - start;
    const share = now - touched < IN_HAND_MS ? REST_SHARE_IN_HAND : REST_SHARE;
    rest_ms = took > SLOW_MS ? Math.min(share * took, LONGEST_REST_MS) : 0;
    drawn();
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
        inside.reportError(error);
      }
    }
    ask(() => measure(start));
  };

  inside.requestAnimationFrame = (callback) => {
    number += 1;
    waiting.set(number, callback);
    if (!asked) {
      asked = true;
      if (rest_ms > 0) setTimeout(() => ask(draw), rest_ms);
      else ask(draw);
    }
    return number;
  };
  inside.cancelAnimationFrame = (id) => void waiting.delete(id);
}
