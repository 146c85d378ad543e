/** Calibrations in words. Pure functions. */

/**
 * Say which files were not imported, and why.
 *
 * @param {string[]} names
 * @param {string} why a sentence, which may begin with one of the names
 */
export function refusalInWords(names, why) {
  const [only] = names;
  if (names.length === 1 && why.startsWith(`${only}: `))
    return `${only} not imported: ${why.slice(`${only}: `.length)}`;
  if (names.length === 1 && why.startsWith(`${only} `)) return `Not imported: ${why}`;
  return `${names.join(" and ")} not imported: ${why}`;
}
