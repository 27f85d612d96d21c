/** Bytes that no encoder makes, or that exceed a limit of docs/format.md. */
export class FormatError extends Error {}

/**
 * Throw `FormatError` unless a condition holds.
 * @param {unknown} condition
 * @param {string} message
 * @returns {asserts condition}
 */
export function check(condition, message) {
  if (!condition) throw new FormatError(message);
}
