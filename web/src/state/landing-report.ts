// Reports of landings, from what a person types; and what a list of them says. Pure.

import type { LandingAnswer, LandingRequest, Plan } from "../service/types";
import { numberOf, numbersOf } from "./numbers";

export type Result = NonNullable<LandingRequest["result"]>;
export const RESULTS: readonly (readonly [Result, string])[] = [["hit", "Hit"], ["edge", "Edge"], ["miss", "Miss"]];
const RADIUS_M = "0.1"; // of a target that has none of its own

/** Returns the report of a place [m] with its uncertainty [m]. Throws InvalidDraft for text that is no number. */
export function placeReport(place: readonly string[], std: string): LandingRequest {
  return { position: numbersOf(place, "landing"), std_m: numberOf(std, "uncertainty"), source: "person" };
}

/** Returns the report whether a target of a radius [m] was hit. Throws InvalidDraft for text that is no number. */
export function resultReport(result: Result, radius: string): LandingRequest {
  return { result, radius_m: numberOf(radius, "radius"), source: "person" };
}

/** Returns the radius of a plan's target as text: its bin's, else a usual one; null for a plan without a target. */
export function targetRadius(plan: Plan | null): string | null {
  const release = plan?.request["release"] as { kind?: string; opening?: { radius_m: number } | null } | undefined;
  if (release?.kind !== "target") return null;
  return release.opening ? String(release.opening.radius_m) : RADIUS_M;
}

/** Returns the newest report that says whether the target was hit, null without one. */
export function newestResult(list: readonly LandingAnswer[]): LandingAnswer | null {
  return counted(list).filter((landing) => landing.result !== null).at(-1) ?? null;
}

export const FAR_M = 1; // [m] chosen: a place farther from the planned landing is more likely a slip; the command line's too

/** Returns how far a reported place is from where a plan's object was to land [m], where that is too far to be likely; else null. */
export function doubtfulDistance(report: LandingRequest, plan: Plan | null): number | null {
  const planned = plan?.flight?.landing_point;
  if (!report.position || !planned) return null;
  const apart = Math.hypot(...report.position.map((value, i) => value - (planned[i] ?? 0)));
  return apart > FAR_M ? apart : null;
}

/** Returns the reports that count. */
export function counted(list: readonly LandingAnswer[]): readonly LandingAnswer[] {
  return list.filter((landing) => landing.withdrawn_at === null || landing.withdrawn_at === undefined);
}
