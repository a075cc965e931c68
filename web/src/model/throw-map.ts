/** A throwability map as a picture of the floor: one pixel a landing cell, coarse points as blocks until finer ones are known. */

import type { MapRequest, ThrowMap } from "../service/types";

export type MapQuantity = "release_time_s" | "landing_shift_10ms_m" | "hit_probability" | "reason";

/** States of a landing cell, as the service numbers them. */
const UNKNOWN = 0;
export const YES = 1;
export const PROVEN = 2;

export type Rgb = readonly [number, number, number];

/** Good is bright. Source: viridis by S. van der Walt and N. Smith (CC0), nine of its colours. */
const STOPS: readonly Rgb[] = [
  [68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140],
  [39, 173, 129], [93, 201, 99], [170, 220, 50], [253, 231, 37],
];
/** Reasons, the most frequent first. Source: the qualitative scheme "bright" by P. Tol, told apart by the colour-blind too. */
const REASONS: readonly Rgb[] = [[238, 102, 119], [68, 119, 170], [204, 187, 68], [34, 136, 51], [170, 51, 119], [102, 204, 238]];
const OTHER: Rgb = [150, 158, 168];
const LAST_SHARE = 0.99; // of the values within the scale: a few far ones would flatten it
/** Opacity of a landing cell by its state, 0 to 255: unknown, yes, proven, searched in vain. */
const OPAQUE = { value: [0, 215, 120, 60], reason: [0, 60, 215, 145] } as const;

/** Whether more of it is better. */
const MORE_IS_BETTER: ReadonlySet<MapQuantity> = new Set(["hit_probability"]);

/** One constraint that refuses landing cells. */
interface ReasonEntry {
  readonly constraint: string;
  readonly colour: Rgb;
  readonly proven: number; // landing cells
  readonly vain: number;
}

/** A map ready to be drawn, with what its legend says. */
export interface MapPicture {
  readonly width: number;
  readonly height: number;
  readonly pixels: Uint8Array; // RGBA, rows along y from the least
  readonly scale: readonly [number, number] | null; // values of the worst and the best colour
  readonly reasons: readonly ReasonEntry[];
}

/** Returns what is asked for to have a map once more: the service goes on with one that is the same. */
export function requestOfMap(map: ThrowMap): MapRequest {
  const { origin, shape, planes_z_m: planes, resolution_m, robust } = map;
  const [x, y] = [origin[0] - resolution_m / 2, origin[1] - resolution_m / 2];
  const extent_m = [x, x + shape[1] * resolution_m, y, y + shape[0] * resolution_m];
  const heights = planes.length > 1 ? { volume_m: [planes[0]!, planes.at(-1)!] } : { plane_z_m: map.plane_z_m };
  return { ...heights, extent_m, resolution_m, robust };
}

/** Returns the picture of a map's quantity. */
export function pictureOfMap(map: ThrowMap, quantity: MapQuantity): MapPicture {
  const [height, width] = map.shape;
  const reasons = reasonEntries(map);
  const values = quantity === "reason" ? null : map.values[quantity];
  const scale = values && scaleOf(values, MORE_IS_BETTER.has(quantity));
  const opacity: readonly number[] = OPAQUE[quantity === "reason" ? "reason" : "value"];
  const pixels = new Uint8Array(4 * width * height);
  const stride = strideOf(map);
  for (let j = 0; j < height; j++) {
    for (let i = 0; i < width; i++) {
      const [row, column] = knownNear(map, stride, j, i);
      const state = map.values.state[row]?.[column] ?? UNKNOWN;
      if (state === UNKNOWN) continue;
      const value = values?.[row]?.[column] ?? null;
      const colour = state === YES ? yesColour(value, scale) : refusedColour(map, row, column, quantity, reasons);
      pixels.set([...colour, opacity[state]!], 4 * (j * width + i));
    }
  }
  return { width, height, pixels, scale, reasons };
}

/** Returns a colour between the worst (0) and the best (1). */
export function goodness(share: number): Rgb {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
  const [low, high] = [STOPS[Math.floor(at)]!, STOPS[Math.ceil(at)]!];
  const rest = at - Math.floor(at);
  return low.map((from, k) => Math.round(from + rest * (high[k]! - from))) as unknown as Rgb;
}

/** Returns the centre of the landing cell about a point [m]; null outside the map. */
export function landingCellAt(map: ThrowMap, x: number, y: number): readonly [number, number] | null {
  const [i, j] = [x, y].map((at, axis) => Math.round((at - map.origin[axis]!) / map.resolution_m)) as [number, number];
  if (j < 0 || i < 0 || j >= map.shape[0] || i >= map.shape[1]) return null;
  return [map.origin[0] + i * map.resolution_m, map.origin[1] + j * map.resolution_m];
}

/** Returns row and column of the landing cell itself, or of the coarse point next to it where it is not known yet. */
function knownNear(map: ThrowMap, stride: number, j: number, i: number): readonly [number, number] {
  if (map.values.state[j]?.[i] !== UNKNOWN) return [j, i];
  const nearest = (at: number, count: number): number => Math.min(Math.floor((at + Math.floor(stride / 2)) / stride), Math.floor((count - 1) / stride)) * stride;
  return [nearest(j, map.shape[0]), nearest(i, map.shape[1])];
}

/** Returns the landing cells from one coarse point to the next: of the finest complete level, or of the first one. */
function strideOf(map: ThrowMap): number {
  if (map.level_m !== null) return Math.max(1, Math.round(map.level_m / map.resolution_m));
  const known = map.values.state.flatMap((line, j) => line.flatMap((state, i) => (state === UNKNOWN ? [] : [j, i])));
  let stride = 1;
  while (known.some((at) => at > 0) && known.every((at) => at % (2 * stride) === 0)) stride *= 2;
  return stride;
}

function yesColour(value: number | null, scale: readonly [number, number] | null): Rgb {
  if (value === null || scale === null) return OTHER;
  const [worst, best] = scale;
  return goodness(best === worst ? 1 : (value - worst) / (best - worst));
}

function refusedColour(map: ThrowMap, j: number, i: number, quantity: MapQuantity, reasons: readonly ReasonEntry[]): Rgb {
  if (quantity !== "reason") return OTHER;
  const constraint = constraintAt(map, j, i);
  return reasons.find((entry) => entry.constraint === constraint)?.colour ?? OTHER;
}

function constraintAt(map: ThrowMap, j: number, i: number): string | null {
  const index = map.values.reason[j]?.[i] ?? null;
  return index === null ? null : (map.reasons[index]?.constraint ?? null);
}

/** Returns the values of the worst and the best colour; null without values. */
function scaleOf(values: readonly (readonly (number | null)[])[], moreIsBetter: boolean): readonly [number, number] | null {
  const known = values.flat().filter((value): value is number => value !== null).sort((a, b) => (moreIsBetter ? b - a : a - b));
  if (known.length === 0) return null;
  return [known[Math.round(LAST_SHARE * (known.length - 1))]!, known[0]!];
}

/** Returns the constraints that refuse landing cells, the most frequent first. */
function reasonEntries(map: ThrowMap): ReasonEntry[] {
  const counts = new Map<string, { proven: number; vain: number }>();
  map.values.state.forEach((line, j) =>
    line.forEach((state, i) => {
      const constraint = state > YES ? constraintAt(map, j, i) : null;
      if (constraint === null) return;
      const count = counts.get(constraint) ?? { proven: 0, vain: 0 };
      count[state === PROVEN ? "proven" : "vain"] += 1;
      counts.set(constraint, count);
    }),
  );
  const sorted = [...counts].sort(([, a], [, b]) => b.proven + b.vain - (a.proven + a.vain));
  return sorted.map(([constraint, count], n) => ({ constraint, colour: REASONS[n] ?? OTHER, ...count }));
}
