// Numbers along the axes of charts. Pure.

const DECIMALS_MAX = 12;
/** Steps between ticks: the 1, 2 and 5 of every power of ten, which need the fewest digits. */
export const TICK_STEPS = Array.from({ length: 24 }, (_, i) => i - DECIMALS_MAX).flatMap((power) => [1, 2, 5].map((step) => Number(`${step}e${power}`)));

/** Returns ticks as text with as many decimals as their step has, and no zero with a sign. */
export function tickTexts(ticks: readonly number[]): string[] {
  const step = Math.min(...ticks.slice(1).map((tick, i) => Math.abs(tick - ticks[i]!)), Infinity);
  const decimals = Number.isFinite(step) && step > 0 ? decimalsOf(step) : 3;
  return ticks.map((tick) => tick.toFixed(decimals).replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−"));
}

function decimalsOf(step: number): number {
  let decimals = 0;
  while (decimals < DECIMALS_MAX && Math.abs(Number(step.toFixed(decimals)) - step) > 1e-6 * step) decimals += 1;
  return decimals;
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
