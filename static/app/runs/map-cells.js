/** A recorded local map as outlines of its cells, for a top view. Pure functions. */

/** @import { PlanMap } from "../contract" */

const STATES = 3;
const FREE = 1;
const BLOCKED = 2;

/**
 * Return the outlines of the cells that are free and of those that are blocked, as the data of SVG
 * paths whose unit is a cell: its x to the right, its y down.
 *
 * @param {PlanMap} map
 */
export function outlinesOf({ size, runs }) {
  let at = 0;
  /** @type {string[][]} */
  const found = [[], [], []];
  runs.forEach((length, k) => {
    const end = at + length;
    // A run may go on in the next row.
    while (at < end) {
      const [x, y] = [Math.floor(at / size), at % size];
      const high = Math.min(end - at, size - y);
      found[k % STATES]?.push(`M${x} ${y}h1v${high}h-1z`);
      at += high;
    }
  });
  return { free: found[FREE]?.join("") ?? "", blocked: found[BLOCKED]?.join("") ?? "" };
}

/**
 * Return the matrix that puts a cell's x and y where the corner of its map and its scale say.
 *
 * @param {PlanMap} map
 * @param {readonly number[]} corner where it is drawn, px right and down
 * @param {number} perMetre px
 */
export function matrixOf({ corner: [, , angle = 0], cell_m }, [right = 0, down = 0], perMetre) {
  const cell = perMetre * cell_m;
  const [along, across] = [cell * Math.cos(angle), cell * Math.sin(angle)];
  // Ahead is up, and left is to the left.
  return [-across, -along, -along, across, right, down];
}
