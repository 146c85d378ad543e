/** Formulas as declared by the server, in MathML. */

/** @import { MethodStep } from "../contract" */

/**
 * @param {MethodStep} step
 * @returns {Node[]} its parts
 */
export function formulaParts({ formula }) {
  return formula.map((part) => {
    const read = new DOMParser().parseFromString(part, "application/xml");
    return document.importNode(read.documentElement, true);
  });
}
