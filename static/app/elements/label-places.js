/** Places for the labels of boxes in an image. Pure functions. */

/** @typedef {{x: number, y: number, width: number, height: number}} Area with its upper left corner */

/**
 * Return where to draw labels so that none covers another: each as near to its wanted place as the
 * labels before it leave room, above or below, and within the image.
 *
 * @param {Area[]} wanted
 * @param {{width: number, height: number}} image
 * @returns {Area[]} of the same sizes, in the same order
 */
export function placeLabels(wanted, image) {
  /** @type {Area[]} */
  const placed = [];
  for (const each of wanted) placed.push(freePlace(each, placed, image));
  return placed;
}

/** @param {Area} wanted @param {Area[]} taken @param {{width: number, height: number}} image */
function freePlace({ x, y, width, height }, taken, image) {
  const within = (/** @type {number} */ value, /** @type {number} */ room) =>
    Math.max(0, Math.min(value, room));
  const first = {
    x: within(x, image.width - width),
    y: within(y, image.height - height),
    width,
    height,
  };
  const beside = taken.flatMap((other) => [other.y - height, other.y + other.height]);
  const rows = [first.y, ...beside]
    .filter((row) => row >= 0 && row + height <= image.height)
    .sort((a, b) => Math.abs(a - first.y) - Math.abs(b - first.y));
  const free = rows
    .map((row) => ({ ...first, y: row }))
    .find((place) => !taken.some((other) => overlaps(place, other)));
  // In a crowd without room, where it is wanted.
  return free ?? first;
}

/** @param {Area} a @param {Area} b */
function overlaps(a, b) {
  return a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
}
