/** Keeps the viewer from taking the page's whole time where 3D is drawn slowly (no GPU). */

// A drawing that lets the page paint again within this is left alone.
const SLOW_MS = 40;
// After a slow one, the page has so many times its duration for itself.
const REST_SHARE = 2;
const LONGEST_REST_MS = 1000;

/**
 * Have a same-origin frame's animation wait after every slow drawing.
 *
 * The frame shares this page's thread: without a GPU one drawing can hold both for 100 ms and
 * more, and drawing without pause would let the live data wait for seconds.
 *
 * @param {Window & typeof globalThis} inside the frame's window, once it is loaded
 */
export function paceFrames(inside) {
  const ask = inside.requestAnimationFrame.bind(inside);
  /** @type {Map<number, FrameRequestCallback>} */
  const waiting = new Map();
  let number = 0;
  let asked = false;
  let restUntil = 0;

  const measure = (/** @type {number} */ start) => {
    const took = performance.now() - start;
    restUntil = took > SLOW_MS ? performance.now() + Math.min(REST_SHARE * took, LONGEST_REST_MS) : 0;
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
      const rest = restUntil - performance.now();
      if (rest > 0) setTimeout(() => ask(draw), rest);
      else ask(draw);
    }
    return number;
  };
  inside.cancelAnimationFrame = (id) => void waiting.delete(id);
}
