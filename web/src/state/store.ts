// The signals that the views read: the one state, what the service reported of cells and executions, the cursor.

import { computed, signal } from "@preact/signals";

import { spanOf } from "../curves/zoom";
import { endOf } from "../model/samples";
import { type MapQuantity, pictureOfMap } from "../model/throw-map";
import { ConnectionLost, ProblemError } from "../service/client";
import type { CellModel, CellState, CellSummary, Curves, Execution, ExecutionMode, LandingAnswer, LandingRequest, Plan, PlanProgress, ProfileList, ThrowMap } from "../service/types";
import type { Calibration } from "./calibration";
import { armKind, obstacleOf } from "./readiness";
import { type Change, change, FIRST_STATE, isArmed, isRunning, planStanding, type State } from "./machine";

export const state = signal<State>(FIRST_STATE);

export function dispatch(what: Change): void {
  state.value = change(state.value, what);
}

/** Cells of the service; null until the first answer. */
export const cells = signal<readonly CellSummary[] | null>(null);
export const cellStates = signal<Readonly<Record<string, CellState>>>({});
/** What the controllers' clocks are ahead of this machine's, by cell [s]. */
export const clockLeads = signal<Readonly<Record<string, number>>>({});
export const model = signal<CellModel | null>(null);
/** Samples and curves of the plan on the screen. */
export const curves = signal<{ readonly planId: string; readonly value: Curves } | null>(null);
/** The plan of the followed execution, where it is another than the one on the screen. */
export const runPlan = signal<Plan | null>(null);

export const history = signal<readonly Execution[] | null>(null);
export const landings = signal<Readonly<Record<string, readonly LandingAnswer[]>>>({});
export const targets = signal<Readonly<Record<string, Plan>>>({}); // summaries by plan id
/** A past execution that is shown instead of the plan; null: the plan is. */
export const viewing = signal<string | null>(null);
/** Executions to be compared, two at most. */
export const compared = signal<readonly string[]>([]);
export const profiles = signal<ProfileList | null>(null);

/** The throwability map of the chosen cell; null until it is asked for, and where there is none. */
export const throwMap = signal<ThrowMap | null>(null);
export const mapShown = signal(false);
export const mapQuantity = signal<MapQuantity>("release_time_s");
export const mapPicture = computed(() => (mapShown.value && throwMap.value ? pictureOfMap(throwMap.value, mapQuantity.value) : null));

export type Connection = "connecting" | "open" | "lost";
export const connection = signal<Connection>("connecting");
export const access = signal<"open" | "token-needed" | "token-refused">("open");
/** A sentence about the last thing that a person did and that did not work; empty where all is well. */
export const notice = signal<Notice | null>(null);
interface Notice {
  readonly text: string;
  readonly kind: "bad" | "good";
  readonly stopOf?: string | null; // execution whose stop did not get through; null: of one that was not known
}

/** What the search for a plan has come to; null where none is under way. */
export const progress = signal<PlanProgress | null>(null);

/** What is wrong with fields of the request, by their path in it. */
export const faults = signal<Readonly<Record<string, string>>>({});

/** The one cursor of scene and curves, on the plan's clock [s]. */
export const time = signal(0);
export const playing = signal<number>(0); // pace: 0 stands still, 1 real time
/** An execution has ended beside its plan: the arm is drawn as it stands until the cursor moves, or another plan is shown. */
export const strayed = signal<Strayed | null>(null);
interface Strayed {
  readonly cell: string | null;
  readonly shown: string | null; // id of the plan
  readonly time: number; // of the cursor [s]
  readonly released: boolean;
}
/** A report of a landing that is likely a slip: it waits for a person's word. */
export const doubt = signal<Doubt | null>(null);
interface Doubt {
  readonly id: string; // of the execution
  readonly report: LandingRequest;
  readonly distance_m: number; // from where it was to land
}
export const picking = signal<string | null>(null); // execution whose landing is being pointed at
export const landingStd = signal("0.02"); // of a reported place, as typed [m]: a click on the floor is about this good
export const dark = signal(false);

/** The guided calibration, on whichever cell; null where none was begun. */
export const calibration = signal<Calibration | null>(null);
/** Whether the guide is open on the cell on the screen. */
export const guided = computed(() => calibration.value !== null && calibration.value.cell === cellName.value);
/** What moves the arm by itself, one move after another; a stop ends it. */
export const driving = signal<{ readonly cell: string; readonly abort: AbortController } | null>(null);

/** The passage whose fields are open, and that is dragged in the scene, by its id; null for none. */
export const openPassage = signal<number | null>(1);

/** How a plan is executed. */
export const mode = signal<ExecutionMode>("speedj");
export const dryRun = signal(false);

// Parts of the state, so that telemetry redraws nothing but what shows it.
export const cellName = computed(() => state.value.cell);
export const draft = computed(() => state.value.request);
export const answered = computed(() => state.value.plan?.value ?? null);
export const preview = computed(() => state.value.preview);
export const problem = computed(() => state.value.problem?.value ?? null);
export const execution = computed(() => state.value.execution);
export const isPlanning = computed(() => state.value.planning !== null);

export const cell = computed(() => cells.value?.find((known) => known.name === cellName.value) ?? null);
export const cellState = computed<CellState | null>(() => cellStates.value[cellName.value ?? ""] ?? null);
/** Whether an arm may move that is not proven to be a simulation. */
export const isReal = computed(() => cell.value !== null && armKind(cell.value) !== "simulated");
export const floorZ = computed(() => model.value?.surroundings.floor_z_m ?? null);
/** Why the arm of the cell cannot move now; null where it can. */
export const hindrance = computed(() =>
  obstacleOf({ lost: connection.value === "lost", asksToken: access.value !== "open", summary: cell.value, live: cellState.value }),
);
/** Why nothing can be thrown on the cell now; null where it can. */
export const obstacle = computed(() => {
  if (viewing.value !== null) return "A past throw is on the screen: go back to the request first.";
  return driving.value !== null ? "The calibration goes on: cancel it first." : hindrance.value;
});
export const armed = computed(() => isArmed(state.value) && obstacle.value === null);
export const running = computed(() => isRunning(state.value));
export const standing = computed(() => planStanding(state.value));

export const runId = computed(() => execution.value?.id ?? null);
const runPlanId = computed(() => execution.value?.planId ?? null);

/** What the scene and the curves show: what runs, else the preview, else the plan. */
export const shown = computed<Plan | null>(() => {
  const followed = runPlan.value !== null && runPlan.value.id === runPlanId.value ? runPlan.value : null;
  if (followed !== null && (running.value || viewing.value === runId.value || answered.value === null)) return followed;
  return preview.value ?? answered.value;
});

/** Id of the plan that is shown; a preview has none. */
export const shownId = computed(() => shown.value?.id ?? null);

/** End of what the cursor runs over: the plan, or the flight where that takes longer [s]. */
export const endTime = computed(() => (shown.value === null ? 0 : endOf(shown.value)));

/** Part of the time that slider and curves show [s]; null: all of it. */
export const zoomed = signal<readonly [number, number] | null>(null);
export const span = computed<readonly [number, number]>(() => spanOf(zoomed.value, endTime.value, time.value));

/** Notes what a failed call says about connection and access; returns it in words. */
export function failed(error: unknown): string {
  if (error instanceof ConnectionLost) {
    connection.value = "lost";
    return error.message;
  }
  if (error instanceof ProblemError) {
    connection.value = "open";
    if (error.problem.status === 401) access.value = access.value === "open" ? "token-needed" : access.value;
    return `${error.problem.title}: ${error.problem.detail}`;
  }
  return error instanceof Error ? error.message : String(error);
}

/** The time of the cell's controller now [s]; null where no executor tells it. */
export function controllerTime(): number | null {
  const lead_s = clockLeads.value[cellName.value ?? ""];
  return lead_s === undefined ? null : lead_s + Date.now() / 1000;
}

export function reached(): void {
  connection.value = "open";
  access.value = "open";
}
