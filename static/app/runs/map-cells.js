/** Outlines of the cells of a recorded local map, for a top view. Pure functions. */

import { MAP_BLOCKED, MAP_FREE, MAP_STATES } from "../elements/facts.js";

/** @import { PlanMap } from "../contract" */

/**
 * Return the outlines of the free and of the blocked cells, as SVG path data in units of cells: x
 * to the right, y down.
 *
 * @param {PlanMap} map
 */
export function outlinesOf({ size, runs }) {
  let at = 0;
  /** @type {string[][]} */
  const found = [[], [], []];
  runs.forEach((length, k) => {
    const end = at + length;
    // A run may continue in the next row.
    while (at < end) {
      const [x, y] = [Math.floor(at / size), at % size];
      const high = Math.min(end - at, size - y);
      found[k % MAP_STATES]?.push(`M${x} ${y}h1v${high}h-1z`);
      at += high;
    }
  });
  return { free: found[MAP_FREE]?.join("") ?? "", blocked: found[MAP_BLOCKED]?.join("") ?? "" };
}

/**
 * Return the SVG matrix from cell coordinates to pixels, given where the map's corner is drawn.
 *
 * @param {PlanMap} map
 * @param {readonly number[]} corner where it is drawn, px right and down
 * @param {number} perMetre px
 */
export function matrixOf({ corner: [, , angle = 0], cell_m }, [right = 0, down = 0], perMetre) {
  const cell = perMetre * cell_m;
  const [along, across] = [cell * Math.cos(angle), cell * Math.sin(angle)];
  // Ahead is up, left is left.
  return [-across, -along, -along, across, right, down];
}
