/** How much of the ground a top view shows. Pure functions. */

/** @import { FrameEntry } from "../contract" */

// Share of the positions that may lie outside on each side: a far outlier would shrink the rest.
const OUTSIDE = 0.02;
const MIN_EXTENT_M = 3;
const MARGIN_PX = 26;
const GRID_PX = 34;
const STEPS = [0.5, 1, 2, 5, 10, 20, 50];

/**
 * Return the centre of the view, in metres ahead and to the left, and its scale.
 *
 * @param {readonly FrameEntry[]} frames of one segment
 * @param {number} wide px
 * @param {number} high px
 */
export function boundsOf(frames, wide, high) {
  const cameras = frames.flatMap(({ plan }) => (plan.camera ? [plan.camera] : []));
  const found = frames.flatMap(({ plan }) => [
    ...plan.obstacles.filter(({ state }) => state === "confirmed").map(({ at }) => at),
    ...plan.truth.map(({ at }) => at),
    ...(plan.goal ? [plan.goal] : []),
  ]);
  const spans = [0, 1].map((axis) => {
    const own = cameras.map((at) => Number(at[axis]));
    const [low, up] = middleOf(found.map((at) => Number(at[axis])));
    const least = Math.min(low, ...extremes(own));
    const most = Math.max(up, ...extremes(own));
    return Number.isFinite(least) ? [least, most] : [-MIN_EXTENT_M / 2, MIN_EXTENT_M / 2];
  });
  const [[back = 0, front = 0] = [], [right = 0, left = 0] = []] = spans;
  const room = (/** @type {number} */ px) => Math.max(px - 2 * MARGIN_PX, px / 2);
  const perMetre = Math.min(
    room(high) / Math.max(front - back, MIN_EXTENT_M),
    room(wide) / Math.max(left - right, MIN_EXTENT_M),
  );
  return { ahead: (front + back) / 2, left: (left + right) / 2, perMetre };
}

/** Return the grid spacing, metres. @param {number} perMetre px */
export function gridOf(perMetre) {
  return STEPS.find((step) => step * perMetre >= GRID_PX) ?? 100;
}

/** @param {number[]} values @returns {[number, number]} */
function middleOf(values) {
  const rising = [...values].sort((a, b) => a - b);
  const outside = Math.floor(OUTSIDE * rising.length);
  return [rising[outside] ?? Infinity, rising[rising.length - 1 - outside] ?? -Infinity];
}

/** @param {number[]} values */
function extremes(values) {
  let [low, up] = [Infinity, -Infinity];
  for (const value of values) [low, up] = [Math.min(low, value), Math.max(up, value)];
  return values.length > 0 ? [low, up] : [];
}
