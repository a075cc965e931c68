// The request as the form holds it: text as typed, so that half a number stays on the screen; and its translation to
// the service's request and back.

import type { Nearest, PlanRequest } from "../service/types";
import { defined, InvalidDraft, numberOf, numbersOf, optional, rounded, texts, textOf } from "./numbers";
import { type PassageDraft, passageOf, passagesOf } from "./passage-draft";
import { FIRST_STATE_DRAFT, observedAt, releaseOf, type StateDraft, stateOf, stateTexts } from "./state-draft";

type Backend = NonNullable<PlanRequest["backend"]>;
export const BACKENDS: readonly Backend[] = ["auto", "casadi", "ruckig", "toppra", "cubic", "trapezoid", "ramp"];
export const ENDS = ["rest", "home", "stated"] as const; // the last: as a plan states it that the form has no field for

/** Everything that a person can ask for: one state, or a motion of passages. Empty text: the service's default. */
export interface Draft extends StateDraft {
  readonly isMotion: boolean; // of `passages`; otherwise the state counts
  readonly passages: readonly PassageDraft[];
  readonly end: (typeof ENDS)[number]; // of a motion
  readonly statedEnd: PlanRequest["end"]; // that of a plan, a joint position or a pose
  readonly frame: "world" | "base";
  readonly startsAfter: string; // least time from when a target that moves is seen to the motion's start [s]
  readonly start: "home" | "current" | "positions";
  readonly startPositions: readonly string[]; // (6) [rad]
  readonly backend: Backend;
  readonly velocityLimit: string; // one number or six [rad/s]
  readonly accelerationLimit: string;
  readonly jerkLimit: string;
  readonly singularityDistance: string;
  readonly window: string; // [s]
  readonly tolerance: string; // [m]
  readonly hitProbability: string;
  readonly timeLimit: string; // [s]
}

export const FIRST_DRAFT: Draft = {
  ...FIRST_STATE_DRAFT,
  isMotion: false,
  passages: [],
  end: "rest",
  statedEnd: null,
  frame: "world",
  startsAfter: "10",
  start: "home",
  startPositions: ["0", "-1.57", "1.57", "-1.57", "-1.57", "0"],
  backend: "auto",
  velocityLimit: "",
  accelerationLimit: "",
  jerkLimit: "",
  singularityDistance: "",
  window: "",
  tolerance: "",
  hitProbability: "",
  timeLimit: "",
};

/** One number for all joints, or six separated by spaces or commas. */
function perJoint(text: string, field: string, path: string): number | number[] | undefined {
  const parts = text.trim().split(/[\s,;]+/).filter(Boolean);
  if (parts.length === 0) return undefined;
  const values = parts.map((part) => numberOf(part, field, path));
  if (values.length === 1) return values[0];
  if (values.length !== 6) throw new InvalidDraft(field, text, path);
  return values;
}

/**
 * Returns the request for `POST /plan`; `now_s` is the controller's time, null where nobody tells it.
 *
 * Throws InvalidDraft for text that is no number.
 */
export function requestOf(draft: Draft, cell: string, now_s: number | null = null): PlanRequest {
  const seen_s = seenAt(draft, now_s);
  const limits = defined({
    velocity: perJoint(draft.velocityLimit, "velocity limit", "limits.velocity"),
    acceleration: perJoint(draft.accelerationLimit, "acceleration limit", "limits.acceleration"),
    jerk: perJoint(draft.jerkLimit, "jerk limit", "limits.jerk"),
  });
  const motion = draft.isMotion
    ? { passages: draft.passages.map((passage, i) => passageOf(passage, `passages[${i}]`, now_s)), end: draft.end === "stated" ? draft.statedEnd : { kind: draft.end } }
    : { release: releaseOf(draft, "release", now_s) };
  return defined({
    cell,
    start: startOf(draft),
    ...motion,
    starts_not_before_s: seen_s === undefined ? undefined : rounded(seen_s + numberOf(draft.startsAfter, "start", "starts_not_before_s")),
    frame: draft.frame,
    backend: draft.backend,
    limits: Object.keys(limits).length > 0 ? limits : undefined,
    singularity_distance_min: optional(draft.singularityDistance, "singularity distance", "singularity_distance_min"),
    release_window_s: optional(draft.window, "release window", "release_window_s"),
    landing_tolerance_m: optional(draft.tolerance, "landing tolerance", "landing_tolerance_m"),
    min_hit_probability: optional(draft.hitProbability, "hit probability", "min_hit_probability"),
    time_limit_s: optional(draft.timeLimit, "time limit", "time_limit_s"),
  }) as PlanRequest;
}

/** Returns when a target that moves is seen, on the controller's clock [s]; undefined where none moves. */
function seenAt(draft: Draft, now_s: number | null): number | undefined {
  if (!draft.isMotion) return observedAt(draft, "release", now_s);
  const times = draft.passages.map(({ isLine, state }, i) => (isLine ? undefined : observedAt(state, `passages[${i}].state`, now_s)));
  return times.find((time) => time !== undefined);
}

function startOf(draft: Draft): PlanRequest["start"] | undefined {
  if (draft.start === "current") return { current: true };
  if (draft.start === "positions") return { positions: numbersOf(draft.startPositions, "start position", "start.positions") };
  return undefined;
}

/** Returns the request of a preview while dragging: the fast back end, for a release on time alone. */
export function previewOf(draft: Draft, cell: string, now_s: number | null = null): PlanRequest {
  const { min_hit_probability: _, ...request } = requestOf(draft, cell, now_s) as PlanRequest & { min_hit_probability?: number };
  return { ...request, backend: "ruckig", release_window_s: 0, landing_tolerance_m: 0 };
}

const text = (value: number | null | undefined, before: string): string =>
  value === null || value === undefined || before === "" ? before : String(value);

/** Returns the draft that asks for what the service offers instead: its release, exactly, and its window. */
export function withNearest(draft: Draft, nearest: Nearest): Draft {
  const release = nearest.release;
  const common = {
    ...draft,
    frame: nearest.frame ?? draft.frame,
    window: nearest.release_window_s === undefined || nearest.release_window_s === null ? draft.window : String(nearest.release_window_s),
    tolerance: nearest.landing_tolerance_m === undefined || nearest.landing_tolerance_m === null ? draft.tolerance : String(nearest.landing_tolerance_m),
    singularityDistance: text(nearest.singularity_distance_min, draft.singularityDistance),
  };
  if (nearest.passages) return { ...common, isMotion: true, passages: passagesOf(nearest.passages) };
  if (!release) return common;
  if (release.kind !== "target") return { ...common, ...stateTexts(release) };
  return {
    ...common,
    kind: "target",
    target: Array.isArray(release.position) ? texts(release.position) : draft.target,
    maxSpeed: text(release.max_release_speed_m_s, draft.maxSpeed),
    minElevation: text(release.min_elevation_rad, draft.minElevation),
    maxElevation: text(release.max_elevation_rad, draft.maxElevation),
    minDistance: text(release.min_horizontal_distance_m, draft.minDistance),
  };
}

/** Returns the form that asks for what a request asks for; what it has no field for is left out. */
export function draftOf(request: PlanRequest): Draft {
  const joints = (value: number | readonly number[] | null | undefined): string => (Array.isArray(value) ? value.join(" ") : textOf(value));
  const start = request.start as { current?: boolean; positions?: number[] } | null | undefined;
  const { release, passages } = request;
  return {
    ...FIRST_DRAFT,
    ...(release ? stateOf(release) : {}),
    ...(passages ? { isMotion: true, passages: passagesOf(passages) } : {}),
    ...endOf(request.end),
    startsAfter: startsAfter(request),
    frame: request.frame ?? FIRST_DRAFT.frame,
    backend: request.backend ?? FIRST_DRAFT.backend,
    start: start?.current ? "current" : start?.positions ? "positions" : "home",
    ...(start?.positions ? { startPositions: texts(start.positions) } : {}),
    velocityLimit: joints(request.limits?.velocity),
    accelerationLimit: joints(request.limits?.acceleration),
    jerkLimit: joints(request.limits?.jerk),
    singularityDistance: textOf(request.singularity_distance_min),
    window: textOf(request.release_window_s),
    tolerance: textOf(request.landing_tolerance_m),
    hitProbability: textOf(request.min_hit_probability),
    timeLimit: textOf(request.time_limit_s),
  };
}

function endOf(end: PlanRequest["end"]): Pick<Draft, "end" | "statedEnd"> {
  if (!end || end.kind === "rest" || end.kind === "home") return { end: end?.kind ?? "rest", statedEnd: null };
  return { end: "stated", statedEnd: end };
}

/** Returns the least time from when a target that moves is seen to the motion's start, as the form holds it. */
function startsAfter({ release, passages, starts_not_before_s: starts_s }: PlanRequest): string {
  const states = [release, ...(passages ?? []).map(({ state }) => state)] as ({ observed_at_s?: number | null } | null | undefined)[];
  const seen_s = states.find((state) => typeof state?.observed_at_s === "number")?.observed_at_s;
  return typeof starts_s === "number" && typeof seen_s === "number" ? String(rounded(starts_s - seen_s)) : FIRST_DRAFT.startsAfter;
}
