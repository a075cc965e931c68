/** Which part of the target a pointer takes hold of. Pure: places on the screen in [px]. */

import type { Vector } from "../model/poses";

export const NEAR_PX = 14; // [px] within which a pointer takes hold of a point
const ARROW_PX = 2.5 * NEAR_PX; // [px] below which the arrow that lifts cannot be told from what it stands on
const FROM_ABOVE = 0.87; // [-] sine of the camera's elevation, 60°, above which the floor alone is dragged

type Place = readonly [number, number];

/** Returns what is taken hold of: the arrow that lifts the target, or its place on the floor. */
export function targetGrip(pointer: Place, middle: Place, tip: Place, sight: Vector, isOnDisc: boolean): "lift" | "floor" | null {
  const toMiddle = apart(pointer, middle);
  const seenFromAbove = -sight[2] > FROM_ABOVE;
  if (!seenFromAbove && apart(tip, middle) > ARROW_PX) {
    const along = [1, 0.75, 0.5].map((share) => apart(pointer, between(middle, tip, share)));
    const toArrow = Math.min(...along);
    if (toArrow < NEAR_PX && toArrow < toMiddle) return "lift";
  }
  return isOnDisc || toMiddle < NEAR_PX ? "floor" : null;
}

function between(a: Place, b: Place, share: number): Place {
  return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];
}

function apart(a: Place, b: Place): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}
