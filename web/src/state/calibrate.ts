// What drives a guided calibration: plans, asks, executes and waits, one move after another, until a person has to decide.

import { computed, effect, signal } from "@preact/signals";

import { ConnectionLost, get, post, ProblemError } from "../service/client";
import { planned } from "../service/events";
import type { CalibrationMoves, Execution, Plan, PlanProgress, PlanRequest, ProfileSummary, TimingAnswer } from "../service/types";
import { adopt, leavePast, loadProfiles, start, stop } from "./actions";
import { begun, type Calibration, candidates, ended, keep, kept, moveWords, next, type Odds, type OddsChange, THROWS } from "./calibration";
import { requestOf } from "./draft";
import { calibration, cell, cellName, controllerTime, driving, failed, guided, isReal, mode, profiles, running, state } from "./store";
import { armKind } from "./readiness";
import { outcomeWords } from "./words";

const LOOK_MS = 300; // between two looks whether an execution has ended
const NO_TARGET = "No other target around the arm is left: estimate a profile from these throws.";
const REFUSALS = ["/problems/infeasible", "/problems/invalid-request"]; // of a candidate: the next one is tried

/** What a calibration on the cell moves; null until it is known. */
export const moves = signal<CalibrationMoves | null>(null);
export const motionCount = computed(() => moves.value?.motions.length ?? 4);
/** What the search for the next move has come to. */
export const seeking = signal<PlanProgress | null>(null);
/** A move of a real arm that waits for a person's word. */
export const asked = signal<Asked | null>(null);
interface Asked {
  readonly plan: Plan;
  readonly answer: (isMeant: boolean) => void;
}

/** The throw of a real arm whose landing the guide asks for; null where it asks for none. */
export const toBeReported = computed(() => {
  const now = calibration.value;
  const isAsked = now !== null && guided.value && isReal.value && now.running === null && driving.value === null;
  const isThrown = isAsked && (now.step === "throws" || (now.step === "profile" && now.profile === null));
  return isThrown ? (now.throws.at(-1)?.id ?? null) : null;
});

/** Brings back what this tab kept, and keeps it; nothing moves until a person says so. */
export function followCalibration(): void {
  calibration.value = kept();
  effect(() => keep(calibration.value));
  effect(() => {
    const cell = cellName.value;
    if (cell !== driving.peek()?.cell) driving.peek()?.abort.abort(); // it drives the cell on the screen alone
    if (moves.peek()?.cell !== cell) void loadMoves(cell);
  });
  if (calibration.value?.running) void drive(async (now) => (await wait(now), false));
}

async function loadMoves(cell: string | null): Promise<void> {
  moves.value = null;
  if (cell === null) return;
  try {
    const answer = await get<CalibrationMoves>(`/cells/${cell}/calibration?throws=${THROWS}`);
    if (state.value.cell === cell) moves.value = answer;
  } catch (error) {
    failed(error);
  }
}

/** Opens the guide where it is not, and brings it into view. */
export function openCalibration(): void {
  if (!guided.value) beginCalibration();
  requestAnimationFrame(() => document.querySelector(".calibration")?.scrollIntoView({ block: "nearest" }));
}

function beginCalibration(): void {
  const { cell } = state.value;
  if (cell === null || driving.value !== null) return;
  void loadMoves(cell);
  calibration.value = begun(cell, profiles.value?.cell === cell ? profiles.value.adopted : null);
}

/** Leaves the guide; what was thrown and measured stays. */
export function closeCalibration(): void {
  if (driving.value === null) calibration.value = null;
}

/** Ends the series: a search at once, a move by a stop. */
export function cancelCalibration(): void {
  void stop(!running.value);
}

/** Goes on until the step is over, something is in the way, or, after a throw of a real arm, a landing has to be reported. */
export async function goOn(): Promise<void> {
  await drive(moveOn);
}

/** Leaves this step as it is; what its moves showed is estimated, and nothing moves. */
export async function skip(): Promise<void> {
  if (driving.value !== null || calibration.value === null) return;
  const now = next(calibration.value);
  const then = now.step === "lag" && now.motions.length === 0 ? next(now) : now; // no motion, nothing to show
  calibration.value = then;
  if (then.step === "lag" || then.step === "profile") await drive(moveOn);
}

/** Uses the profile of this step from now on, and goes to the next. */
export async function adoptAndGoOn(): Promise<void> {
  const now = calibration.value;
  if (now === null || now.profile === null) return;
  await adopt(now.profile);
  if (profiles.value?.adopted === now.profile && calibration.value === now) calibration.value = next(now);
}

/** Runs steps on the calibration as it is, one at a time, while they return true. */
async function drive(step: (now: Calibration, signal: AbortSignal) => Promise<boolean>): Promise<void> {
  const first = calibration.value;
  if (first === null || driving.value !== null) return;
  const mine = { cell: first.cell, abort: new AbortController() };
  driving.value = mine;
  calibration.value = { ...first, trouble: null };
  leavePast();
  try {
    let goes = true;
    while (goes && !mine.abort.signal.aborted && calibration.value !== null) goes = await step(calibration.value, mine.abort.signal);
  } catch (error) {
    if (!mine.abort.signal.aborted) update({ trouble: failed(error) });
  } finally {
    driving.value = asked.value = seeking.value = null;
  }
}

function update(fields: Partial<Calibration>): void {
  if (calibration.value !== null) calibration.value = { ...calibration.value, ...fields };
}

/** Does what is next; returns whether something is next after it, without a person's word. */
async function moveOn(now: Calibration, signal: AbortSignal): Promise<boolean> {
  if (now.running !== null) return wait(now);
  if (now.step === "lag" || now.step === "profile") {
    if (now.profile === null) await estimate(now, signal);
    return false;
  }
  if (now.step === "done") return false;
  const plan = await nextPlan(now, signal);
  if (signal.aborted || (!isSimulated() && !(await isMeant(plan, signal)))) return false;
  const { id } = await start(plan.id, mode.value, false);
  update({ running: id });
  return wait(calibration.value!);
}

/** Waits for the end of what runs; returns whether the step goes on by itself. */
async function wait(now: Calibration): Promise<boolean> {
  const run = await endOf(now.running!);
  const wanted = now.step === "motions" ? motionCount.value : THROWS;
  const words = `${moveWords(now, motionCount.value)}: ${outcomeWords({ ...run, dryRun: run.dry_run })}.`;
  const then = ended(now, run, wanted, words);
  calibration.value = then;
  const isToBeReported = !isSimulated() && now.step === "throws";
  return then.trouble === null && !isToBeReported;
}

async function endOf(id: string): Promise<Execution> {
  for (;;) {
    try {
      const run = await get<Execution>(`/executions/${id}`);
      if (run.state === "finished") return run;
    } catch (error) {
      const isOver = error instanceof ProblemError && error.problem.status < 500;
      if (isOver) update({ running: null });
      if (!(error instanceof ConnectionLost) && (isOver || !(error instanceof ProblemError))) throw error;
    }
    await new Promise((resume) => setTimeout(resume, LOOK_MS));
  }
}

/** Whether the arm is known to be simulated: what is not is asked about. */
function isSimulated(): boolean {
  return cell.value !== null && armKind(cell.value) === "simulated";
}

/** Returns the plan of the first candidate that is not refused. */
async function nextPlan(now: Calibration, signal: AbortSignal): Promise<Plan> {
  if (moves.value?.cell !== now.cell) await loadMoves(now.cell);
  const known = moves.value;
  if (known === null) throw new Error("The service did not tell what a calibration moves. Go on in a moment.");
  let refusal: unknown = new Error(NO_TARGET);
  for (const request of candidates(now, known)) {
    if (now.step === "throws") update({ tried: calibration.value!.tried + 1 });
    try {
      return await planned(request as unknown as PlanRequest, (told) => (seeking.value = told), signal);
    } catch (error) {
      if (!(error instanceof ProblemError && REFUSALS.includes(error.problem.type))) throw error;
      refusal = now.step === "motions" ? error : new Error(`${NO_TARGET} The last one was refused: ${error.message}`);
    } finally {
      seeking.value = null;
    }
  }
  throw refusal;
}

function isMeant(plan: Plan, signal: AbortSignal): Promise<boolean> {
  return new Promise((resolve) => {
    const answer = (isYes: boolean): void => {
      asked.value = null;
      resolve(isYes && !signal.aborted);
    };
    signal.addEventListener("abort", () => answer(false));
    asked.value = { plan, answer };
  });
}

/** Estimates a profile from all that is known of the cell, and what it changes. */
async function estimate(now: Calibration, signal: AbortSignal): Promise<void> {
  const timing = await get<TimingAnswer>(`/cells/${now.cell}/timing`);
  const { id, lag_s, lag_std_s } = await post<ProfileSummary>(`/cells/${now.cell}/profiles`, undefined, { patient: true });
  await loadProfiles(now.cell);
  const isOther = typeof timing.pooled?.lag_change_s === "number";
  const lag = { assumed_s: timing.assumed_lag_s, measured_s: lag_std_s === null ? null : lag_s, std_s: lag_std_s ?? 0, isOther };
  update(now.step === "lag" ? { profile: id, lag } : { profile: id });
  if (now.step === "profile") update({ odds: await oddsChange(now, id, signal) });
}

/** The odds of the form's own throw, with the profile of before and with this one; null where the form asks for none. */
async function oddsChange(now: Calibration, profile: string, signal: AbortSignal): Promise<OddsChange | null> {
  try {
    const { min_hit_probability: _, ...request } = requestOf(state.value.request, now.cell, controllerTime()) as PlanRequest & { min_hit_probability?: number };
    if (request.release?.kind !== "target") return null;
    const odds = async (id: string): Promise<Odds | null> =>
      (await post<Plan>(`/plan?store=false&trajectory=false&profile=${id}`, request, { signal })).hit_probability ?? null;
    const after = await odds(profile);
    const target = request.release.position as number[];
    return after && { target, before: now.before === null ? null : await odds(now.before), after };
  } catch {
    return null; // a throw that the form cannot ask for says nothing of the profile
  }
}
