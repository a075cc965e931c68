// A guided calibration as it stands: what has moved, what is next, what came out. Pure but for the tab's storage.

import type { CalibrationMoves, Execution, Plan } from "../service/types";

export const THROWS = 8; // after which the delay is within its own scatter: docs/learning.md
export const THROWS_MIN = 2; // of which a profile can be estimated

/** In their order: moves, and what they showed. */
export const STEPS = ["motions", "lag", "throws", "profile", "done"] as const;
export type Step = (typeof STEPS)[number];

/** A motion or throw that was completed. */
export interface Move {
  readonly id: string; // of the execution
  readonly planId: string;
  readonly lag_s: number | null; // that it shows
}

/** The lag that was measured, against that of plans so far. */
export interface Lag {
  readonly assumed_s: number;
  readonly measured_s: number | null; // null: no run shows it
  readonly std_s: number;
  readonly isOther: boolean; // significantly
}

/** How likely one throw hits. */
export type Odds = NonNullable<Plan["hit_probability"]>;

/** The odds of the target in the form, before and after. */
export interface OddsChange {
  readonly target: readonly number[]; // [m]
  readonly before: Odds | null; // null: not known, without a profile
  readonly after: Odds;
}

export interface Calibration {
  readonly cell: string;
  readonly step: Step;
  readonly before: string | null; // profile that the cell used at the beginning; null: its file's numbers
  readonly motions: readonly Move[];
  readonly throws: readonly Move[];
  readonly tried: number; // candidates of throws that are used up: no two throws are alike
  readonly running: string | null; // execution under way
  readonly trouble: string | null; // why it stands still, in words
  readonly lag: Lag | null;
  readonly profile: string | null; // what came out of this step
  readonly odds: OddsChange | null;
}

export function begun(cell: string, before: string | null): Calibration {
  return { cell, step: "motions", before, motions: [], throws: [], tried: 0, running: null, trouble: null, lag: null, profile: null, odds: null };
}

/** An execution has ended: it counts where it was completed, and the last one of its kind ends the step. */
export function ended(now: Calibration, run: Execution, wanted: number, words: string): Calibration {
  const still = { ...now, running: null };
  const kind = now.step;
  if (kind !== "motions" && kind !== "throws") return still;
  if (run.outcome !== "completed") return { ...still, trouble: words };
  const timing = run.metrics?.["timing"] as { lag_s: number } | null | undefined;
  const moves = [...now[kind], { id: run.id, planId: run.plan_id, lag_s: timing?.lag_s ?? null }];
  const counted = { ...still, trouble: null, [kind]: moves };
  return moves.length < wanted ? counted : next(counted);
}

/** Goes to the next step. */
export function next(now: Calibration): Calibration {
  const step = STEPS[Math.min(STEPS.indexOf(now.step) + 1, STEPS.length - 1)]!;
  return { ...now, step, trouble: null, profile: step === "done" ? now.profile : null };
}

/** The first requests to try for what moves next, the rest if they are refused. */
export function candidates(now: Calibration, moves: CalibrationMoves): CalibrationMoves["throws"] {
  return now.step === "motions" ? (moves.motions[now.motions.length % moves.motions.length] ?? []) : moves.throws.slice(now.tried);
}

/** What moves next, in words. */
export function moveWords(now: Calibration, motions: number): string {
  return now.step === "motions" ? `Motion ${now.motions.length + 1} of ${motions}` : `Throw ${now.throws.length + 1} of ${THROWS}`;
}

const KEY = "fling-calibration";

/** Keeps a calibration for this tab; nothing that runs is lost by a reload. */
export function keep(now: Calibration | null): void {
  if (now === null) sessionStorage.removeItem(KEY);
  else sessionStorage.setItem(KEY, JSON.stringify(now));
}

/** Returns the calibration that this tab kept; null without one. */
export function kept(): Calibration | null {
  try {
    return JSON.parse(sessionStorage.getItem(KEY) ?? "null") as Calibration | null;
  } catch {
    return null;
  }
}
