/**
 * For the middle of each of `count` samples the two of `known` around it, and how far it is between
 * them; before the first and after the last it is there.
 * @param {number} count
 * @param {number} known
 * @param {number} span samples that the known ones stand for
 */
export function linearPlaces(count, known, span = count) {
  const low = new Int32Array(count);
  const high = new Int32Array(count);
  const part = new Float64Array(count);
  for (let i = 0; i < count; i++) {
    const at = Math.min(Math.max(((i + 0.5) * known) / span - 0.5, 0), known - 1);
    low[i] = Math.floor(at);
    high[i] = Math.min(low[i] + 1, known - 1);
    part[i] = at - low[i];
  }
  return { low, high, part };
}
