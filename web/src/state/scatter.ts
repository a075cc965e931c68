// Spread of landings about their targets. Pure.

import { principalAxes } from "../model/spread";
import { counted } from "./landing-report";
import type { LandingList } from "../service/types";

export type Offset = readonly [number, number]; // landing less target, x and y [m]

interface Spread {
  readonly center: Offset; // [m]
  readonly axes: readonly [number, number]; // two standard deviations along the principal axes [m]
  readonly turn_deg: number; // of the first axis against x
}

const LEAST = 3; // landings below which an ellipse says nothing

/** Where the newest observation saw an object land, in the world; null without one. */
export function seenAt(list: readonly LandingList["landings"][number][]): readonly number[] | null {
  return counted(list).filter((landing) => landing.position !== null).at(-1)?.position ?? null;
}

/** Returns how far from an aim the newest observation saw an object land [m]; null without either. */
export function offsetFrom(aim: readonly number[] | null, list: readonly LandingList["landings"][number][]): Offset | null {
  const seen = seenAt(list);
  return aim && seen && [(seen[0] ?? 0) - (aim[0] ?? 0), (seen[1] ?? 0) - (aim[1] ?? 0)];
}

/** Returns the ellipse of two standard deviations; null for fewer than three landings. */
export function ellipseOf(points: readonly Offset[]): Spread | null {
  const n = points.length;
  if (n < LEAST) return null;
  const mean = (values: readonly number[]): number => values.reduce((sum, value) => sum + value, 0) / n;
  const cx = mean(points.map(([x]) => x));
  const cy = mean(points.map(([, y]) => y));
  const cover = (f: (x: number, y: number) => number): number =>
    points.reduce((sum, [x, y]) => sum + f(x - cx, y - cy), 0) / (n - 1);
  const axes = principalAxes(cover((x) => x * x), cover((x, y) => x * y), cover((_, y) => y * y));
  return axes && { center: [cx, cy], axes: [2 * axes.long, 2 * axes.short], turn_deg: (axes.turn * 180) / Math.PI };
}
