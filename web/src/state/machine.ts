// The one state of the page, {cell, request, plan, execution}, and every way it changes. Pure: no network, no clock.
//
// Two rules keep it safe. A plan answers the request with the number `revision`; any edit raises that number, and a
// plan of another number cannot be thrown. And what is shown as running belongs to the cell, whoever started it.

import type { Execution, Plan, ProblemDocument } from "../service/types";
import { type Draft, FIRST_DRAFT } from "./draft";

/** An answer of the planner, with the request it answers. */
interface Answered<T> {
  readonly revision: number;
  readonly value: T;
}

export interface Sample {
  readonly clock_s: number; // on the plan's clock
  readonly positions: readonly number[]; // [rad]
  readonly planned: readonly number[]; // [rad]
}

/** One execution of the cell, as it is followed. */
export interface Run {
  readonly id: string;
  readonly planId: string | null;
  readonly state: string; // queued … finished
  readonly seen: readonly string[]; // those of these that were seen, in their order
  readonly outcome: string | null;
  readonly reason: string | null;
  readonly metrics: Readonly<Record<string, unknown>> | null;
  readonly samples: readonly Sample[];
  readonly stopping: boolean; // a stop was asked for
  readonly dryRun: boolean; // everything but motion
  readonly createdAt: string | null; // UTC, ISO 8601
}

export interface State {
  readonly cell: string | null;
  readonly request: Draft;
  readonly revision: number;
  readonly planning: number | null; // revision of the request that is being planned
  readonly plan: Answered<Plan> | null;
  readonly preview: Plan | null; // while dragging
  readonly problem: Answered<ProblemDocument> | null;
  readonly execution: Run | null;
}

export const FIRST_STATE: State = {
  cell: null,
  request: FIRST_DRAFT,
  revision: 0,
  planning: null,
  plan: null,
  preview: null,
  problem: null,
  execution: null,
};

export type Change =
  | { readonly type: "cell"; readonly name: string }
  | { readonly type: "edit"; readonly request: Draft }
  | { readonly type: "restored"; readonly cell: string; readonly request: Draft; readonly plan: Plan | null; readonly answers: boolean }
  | { readonly type: "ask" }
  | { readonly type: "planned"; readonly revision: number; readonly plan: Plan }
  | { readonly type: "refused"; readonly revision: number; readonly problem: ProblemDocument }
  | { readonly type: "gave-up"; readonly revision: number }
  | { readonly type: "preview"; readonly plan: Plan | null }
  | { readonly type: "runs"; readonly cell: string; readonly id: string }
  | { readonly type: "execution"; readonly execution: Execution }
  | { readonly type: "event"; readonly id: string; readonly kind: string; readonly data: Record<string, unknown> }
  | { readonly type: "stopping"; readonly id: string };

/** Returns the state after a change. */
export function change(state: State, what: Change): State {
  switch (what.type) {
    case "cell":
      return what.name === state.cell
        ? state
        : { ...state, cell: what.name, revision: state.revision + 1, preview: null, problem: null, execution: null };
    case "edit":
      return { ...state, request: what.request, revision: state.revision + 1, problem: null };
    case "restored":
      return restored(state, what.cell, what.request, what.plan, what.answers);
    case "ask":
      return { ...state, planning: state.revision, problem: null };
    case "planned":
      return {
        ...state,
        planning: ended(state, what.revision),
        plan: { revision: what.revision, value: what.plan },
        preview: null,
      };
    case "refused":
      return refused(state, what.revision, what.problem);
    case "gave-up":
      return { ...state, planning: ended(state, what.revision) };
    case "preview":
      return { ...state, preview: what.plan };
    case "runs":
      return what.cell === state.cell && state.execution?.id !== what.id
        ? { ...state, execution: newRun(what.id, null) }
        : state;
    case "execution":
      return withExecution(state, what.execution);
    case "event":
      return state.execution?.id === what.id
        ? { ...state, execution: withEvent(state.execution, what.kind, what.data) }
        : state;
    case "stopping":
      return state.execution?.id === what.id ? { ...state, execution: { ...state.execution, stopping: true } } : state;
  }
}

/** A plan that an address names, with a form; only where the plan answers that form may it be thrown. */
function restored(state: State, cell: string, request: Draft, plan: Plan | null, answers: boolean): State {
  const revision = state.revision + 1;
  const own = plan === null ? null : { revision: answers ? revision : state.revision, value: plan };
  const execution = cell === state.cell ? state.execution : null;
  return { ...state, cell, request, revision, plan: own, preview: null, problem: null, planning: null, execution };
}

function ended(state: State, revision: number): number | null {
  return state.planning === revision ? null : state.planning;
}

/** A refusal of a request that has been edited since says nothing about the one on the screen. */
function refused(state: State, revision: number, problem: ProblemDocument): State {
  const planning = ended(state, revision);
  if (revision !== state.revision) return { ...state, planning };
  return { ...state, planning, preview: null, problem: { revision, value: problem } };
}

function newRun(id: string, planId: string | null): Run {
  return {
    id, planId, state: "queued", seen: [], outcome: null, reason: null, metrics: null, samples: [], stopping: false, dryRun: false,
    createdAt: null,
  };
}

export const PHASES = ["queued", "preparing", "approaching", "streaming", "braking", "finished"] as const;

/** Returns the place of a state among the phases. */
export function orderOf(phase: string): number {
  return PHASES.indexOf(phase as (typeof PHASES)[number]);
}

/** An answer that was on its way when an event came is older than the event: a state never goes back. */
function withExecution(state: State, execution: Execution): State {
  if (execution.cell !== state.cell) return state;
  const shown = state.execution;
  if (shown !== null && shown.id !== execution.id && isRunning(state) && execution.state === "finished") return state;
  const before = shown?.id === execution.id ? shown : newRun(execution.id, execution.plan_id);
  const stopping = before.stopping || execution.abort_requested_at !== null;
  const run: Run = { ...before, planId: execution.plan_id, stopping, dryRun: execution.dry_run, createdAt: execution.created_at };
  if (orderOf(execution.state) < orderOf(before.state)) return { ...state, execution: run };
  const { outcome, reason, metrics } = execution;
  const seen = { ...run, state: execution.state, outcome, reason, metrics: metrics ?? before.metrics };
  return { ...state, execution: withPhase(seen) };
}

function withEvent(run: Run, kind: string, data: Record<string, unknown>): Run {
  if (kind === "telemetry") {
    const sample = sampleOf(data);
    return sample === null ? run : { ...run, samples: [...run.samples, sample] };
  }
  if (kind === "state") {
    const seen = {
      ...run,
      state: String(data["state"] ?? run.state),
      outcome: (data["outcome"] as string | null | undefined) ?? run.outcome,
      reason: (data["reason"] as string | null | undefined) ?? run.reason,
      metrics: (data["metrics"] as Run["metrics"] | undefined) ?? run.metrics,
    };
    return withPhase(seen);
  }
  return run;
}

function withPhase(run: Run): Run {
  return run.seen.includes(run.state) ? run : { ...run, seen: [...run.seen, run.state] };
}

/** Whether an execution went through a phase, as far as was seen; one that is stopped may brake without having thrown. */
export function wentThrough(phase: string, { state, seen, outcome, metrics }: Run): boolean {
  const ended = state === "finished";
  if (phase === "finished") return ended;
  if (ended && (outcome === "completed" || metrics?.["released"] === true)) return true;
  const last = seen.filter((each) => each !== "finished").at(-1);
  const skipped = phase === "streaming" && seen.includes("approaching") && !seen.includes(phase);
  if (last === undefined || skipped) return false;
  return ended ? orderOf(phase) <= orderOf(last) : orderOf(phase) < orderOf(state);
}

function sampleOf(data: Record<string, unknown>): Sample | null {
  const { clock_s, positions, planned_positions } = data;
  if (typeof clock_s !== "number" || !Array.isArray(positions)) return null;
  return {
    clock_s,
    positions: positions as number[],
    planned: Array.isArray(planned_positions) ? (planned_positions as number[]) : [],
  };
}

/** How the plan on the screen is to be read; `none` where there is none. */
type PlanStanding = "none" | "valid" | "stale";

export function planStanding(state: State): PlanStanding {
  if (state.plan === null) return "none";
  return state.plan.revision === state.revision && state.plan.value.cell === state.cell ? "valid" : "stale";
}

export function isRunning(state: State): boolean {
  return state.execution !== null && state.execution.state !== "finished";
}

/** Whether the plan on the screen may be thrown: it answers exactly this request on exactly this cell. */
export function isArmed(state: State): boolean {
  return planStanding(state) === "valid" && state.planning === null && state.preview === null && !isRunning(state);
}

/** Where a plan aims, in the world: its target, or where its object lands or meets it; null for a move to rest. */
export function aimOf(plan: Plan): readonly number[] | null {
  const release = plan.request["release"] as { kind?: string; position?: number[] } | undefined;
  const inWorld = release?.kind === "target" && plan.request["frame"] !== "base" && typeof plan.starts_at_s !== "number";
  return (inWorld ? release.position : plan.flight?.landing_point) ?? null;
}

const FLAT_M = 0.005; // less than this is shown as the floor's height: labels have two digits

/** A place in words: with its height unless that is the floor's, which may be unknown. */
export function placeWords(place: readonly number[], floorZ: number | null): string {
  const onFloor = floorZ !== null && Math.abs((place[2] ?? floorZ) - floorZ) < FLAT_M;
  const shown = onFloor ? place.slice(0, 2) : place;
  return `(${shown.map((x) => x.toFixed(2).replace(/^-(0\.0+)$/, "$1").replace("-", "−")).join(", ")})`;
}

/** Label of the button that moves the arm: names the cell and where the object goes. */
export function throwLabel(plan: Plan | null, floorZ: number | null): string {
  if (plan === null) return "Throw";
  const place = aimOf(plan);
  if (!place && plan.passages) return `Throw on ${plan.cell}: a motion through ${plan.passages.map(({ name }) => name).join(", ")}`;
  if (!place) return `Throw on ${plan.cell}: a move that ends at rest`;
  return `Throw on ${plan.cell} to ${placeWords(place, floorZ)}`;
}
