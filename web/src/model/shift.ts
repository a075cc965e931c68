// The chart of a shift: when each object was thrown, and how far from its target it landed.

import type { ObjectResult } from "../service/types";

/** A landing that was seen. */
export interface SeenThrow {
  readonly pick: number;
  readonly minute: number; // since the first motion [min]
  readonly error_m: number;
  readonly isHit: boolean;
}

/** An object that reached no target, and when that was known. */
export interface PutAside {
  readonly pick: number;
  readonly minute: number; // [min]
}

export interface Shift {
  readonly landings: readonly SeenThrow[];
  readonly aside: readonly PutAside[];
  readonly minutes: number; // length of the chart [min], of at least one
  readonly error_m: number; // its height [m]: the least of 10, 20, 50, 100 … mm that holds every landing
}

const ASIDE = new Set(["missed_grip", "not_planned", "kept", "unknown"]);
const HEIGHTS_M = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5];

/** Returns what the chart shows of these objects; null where nothing has ended yet. */
export function shiftOf(objects: readonly ObjectResult[]): Shift | null {
  const ended = objects.filter((each) => each.ended_at !== null);
  if (ended.length === 0) return null;
  const first = Math.min(...ended.map((each) => Date.parse(each.asked_at ?? each.ended_at!)));
  const minute = (each: ObjectResult): number => (Date.parse(each.ended_at!) - first) / 60_000;
  const landings = ended.flatMap((each) =>
    each.error_m === null ? [] : [{ pick: each.pick, minute: minute(each), error_m: each.error_m, isHit: each.result === "hit" }],
  );
  const aside = ended.filter((each) => ASIDE.has(each.result)).map((each) => ({ pick: each.pick, minute: minute(each) }));
  const farthest = Math.max(0, ...landings.map((each) => each.error_m));
  return {
    landings,
    aside,
    minutes: Math.max(1, ...ended.map(minute)),
    error_m: HEIGHTS_M.find((height) => height >= farthest) ?? farthest,
  };
}
