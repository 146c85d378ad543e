/** Keeps the viewer from holding up the live data where 3D is drawn slowly (no GPU). */

// A drawing that lets the page paint again within this is left alone.
const SLOW_MS = 40;
// After a slow one, the page has so many times its duration for itself: few enough drawings that
// most observations meet none.
const REST_SHARE = 5;
// Somebody who turns the scene wants to see it turn, and bears later data meanwhile.
const REST_SHARE_IN_HAND = 1;
const IN_HAND_MS = 1000;
const LONGEST_REST_MS = 1000;
// While nothing new arrives, drawing goes on all the same: somebody may turn the scene.
const LONGEST_TURN_MS = 150;

/**
 * Have a same-origin frame's animation wait after every slow drawing.
 *
 * The frame shares this page's thread: without a GPU one drawing can hold both for 100 ms and
 * more, and drawing without pause would let the live data wait for seconds. A slow drawing begins
 * right after an observation has been painted: then there is most time until the next one comes.
 *
 * @param {Window & typeof globalThis} inside the frame's window, once it is loaded
 * @param {EventTarget} hub tells `painted`
 * @param {() => void} drawn called after every drawing
 */
export function paceFrames(inside, hub, drawn) {
  const ask = inside.requestAnimationFrame.bind(inside);
  /** @type {Map<number, FrameRequestCallback>} */
  const waiting = new Map();
  let number = 0;
  let asked = false;
  let restUntil = 0;
  let touched = -IN_HAND_MS;

  for (const kind of ["pointerdown", "pointermove", "wheel", "keydown"]) {
    const touch = (/** @type {Event} */ event) => {
      const hovers = event instanceof inside.PointerEvent && event.buttons === 0;
      if (!hovers) touched = performance.now();
    };
    inside.addEventListener(kind, touch, { capture: true, passive: true });
  }

  const inTurn = (/** @type {() => void} */ begin) => {
    const turn = new AbortController();
    const { signal } = turn;
    const take = () => {
      if (signal.aborted) return;
      turn.abort();
      begin();
    };
    hub.addEventListener("painted", take, { signal });
    setTimeout(take, LONGEST_TURN_MS);
  };

  const measure = (/** @type {number} */ start) => {
    const now = performance.now();
    const took = now - start;
    const share = now - touched < IN_HAND_MS ? REST_SHARE_IN_HAND : REST_SHARE;
    restUntil = took > SLOW_MS ? now + Math.min(share * took, LONGEST_REST_MS) : 0;
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
      const rest = restUntil - performance.now();
      if (restUntil > 0) setTimeout(() => inTurn(() => ask(draw)), rest);
      else ask(draw);
    }
    return number;
  };
  inside.cancelAnimationFrame = (id) => void waiting.delete(id);
}
