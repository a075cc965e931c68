// Which part of a plan's time is shown. Pure.

export type Span = readonly [number, number]; // [s]

const LEAST_S = 0.02; // [s] ten ticks of an e-Series arm
const WHOLE = 0.999; // share of all above which it is all that is shown

/** Returns the part that is shown: all of it, or the chosen one, moved so that the cursor stays in it. */
export function spanOf(chosen: Span | null, end_s: number, time_s: number): Span {
  if (chosen === null || end_s <= 0) return [0, end_s > 0 ? end_s : 1];
  const width = Math.min(chosen[1] - chosen[0], end_s);
  const from = time_s < chosen[0] ? time_s : time_s > chosen[0] + width ? time_s - width : chosen[0];
  return within(from, width, end_s);
}

/** Returns a span that is `factor` times as wide, about an instant that stays where it is; null: all of it. */
export function zoom([from, to]: Span, factor: number, at_s: number, end_s: number): Span | null {
  const width = Math.max(LEAST_S, factor * (to - from));
  if (width >= WHOLE * end_s) return null;
  const share = (at_s - from) / (to - from);
  return within(at_s - share * width, width, end_s);
}

function within(from: number, width: number, end_s: number): Span {
  const first = Math.min(Math.max(from, 0), Math.max(0, end_s - width));
  return [first, first + width];
}
