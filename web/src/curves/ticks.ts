// Numbers along the axes of charts. Pure.

/** Returns ticks as text with as many decimals as tell them apart, and no zero with a sign. */
export function tickTexts(ticks: readonly number[]): string[] {
  const steps = ticks.slice(1).map((tick, i) => Math.abs(tick - ticks[i]!));
  const step = Math.min(...steps, Infinity);
  const decimals = Number.isFinite(step) && step > 0 ? Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)) : 3;
  return ticks.map((tick) => tick.toFixed(Math.min(decimals, 12)).replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−"));
}

const LEAST_SPAN = 1e-3; // [of the quantity's unit] less than this is rounding, and drawn as a straight line
const ROOM = 0.08; // of the range, above and below

/** Returns the range of an axis for values, and for those limits that lie within reach of them. */
export function axisRange(values: readonly (number | null)[], limits: readonly number[]): [number, number] {
  const known = values.filter((value): value is number => value !== null && Number.isFinite(value));
  if (known.length === 0) return [0, 1];
  let low = known.reduce((a, b) => Math.min(a, b));
  let high = known.reduce((a, b) => Math.max(a, b));
  const missing = LEAST_SPAN - (high - low);
  if (missing > 0) [low, high] = [low - missing / 2, high + missing / 2];
  const span = high - low;
  for (const limit of limits) {
    if (limit > high && limit < high + span) high = limit;
    if (limit < low && limit > low - span) low = limit;
  }
  const room = ROOM * (high - low);
  return [low - room, high + room];
}
