// What a person does: edit, plan, drag, throw, stop, acknowledge, report a landing, adopt a profile.

import { call, ConnectionLost, get, keepToken, post, ProblemError, token } from "../service/client";
import { planned } from "../service/events";
import type { CellState, Curves, Execution, ExecutionMode, LandingAnswer, LandingRequest, MapRequest, Plan, ProfileList, ThrowMap } from "../service/types";
import { type Draft, previewOf, requestOf, withNearest } from "./draft";
import { InvalidDraft } from "./numbers";
import { doubtfulDistance, placeReport } from "./landing-report";
import { hashOf, type Link } from "./links";
import { aimOf, placeWords } from "./machine";
import {
  access, armed, cellStates, clockLeads, controllerTime, curves, dispatch, doubt, driving, failed, faults, floorZ, landings, landingStd, notice, picking, playing, profiles, progress, reached, runPlan, shownId, state, throwMap, time, viewing,
} from "./store";
import { cancelledWords, dateWords, landingWords } from "./words";

export function edit(fields: Partial<Draft>): void {
  faults.value = {};
  leavePast();
  dispatch({ type: "edit", request: { ...state.value.request, ...fields } });
}

/** Shows the plan again where a past throw was shown. */
export function leavePast(): void {
  if (viewing.value === null) return;
  viewing.value = null;
  time.value = 0;
  const own = state.value.plan?.value;
  if (own) nameInAddress({ kind: "plan", id: own.id });
}

/** Names what is on the screen in the address: a reload, or somebody else, comes to it again. */
export function nameInAddress(link: Link): void {
  history.replaceState(null, "", hashOf(link));
}

let search: AbortController | null = null;

/** Asks for the full answer to the request as it is now; a search that is under way ends. */
export async function plan(): Promise<void> {
  const { cell, request, revision } = state.value;
  if (cell === null) return;
  notice.value = null;
  leavePast();
  stopPreview();
  dispatch({ type: "ask" });
  search?.abort();
  const mine = new AbortController();
  search = mine;
  try {
    const answer = await planned(requestOf(request, cell, controllerTime()), (told) => search === mine && (progress.value = told), mine.signal);
    reached();
    dispatch({ type: "planned", revision, plan: answer });
    nameInAddress({ kind: "plan", id: answer.id });
    if (revision === state.value.revision) {
      time.value = 0;
      playing.value = 1;
    }
  } catch (error) {
    if (!mine.signal.aborted) refuse(revision, error);
  } finally {
    if (search === mine) {
      search = null;
      progress.value = null;
      dispatch({ type: "gave-up", revision });
    }
  }
}

/** Ends the search for a plan: the service hears of it, and so does its planner process. */
export function cancelPlan(): void {
  const soFar = progress.value;
  search?.abort();
  notice.value = { kind: "good", text: soFar === null ? "Cancelled." : cancelledWords(soFar) };
}

function refuse(revision: number, error: unknown): void {
  if (revision === state.value.revision) faults.value = faultsOf(error);
  if (error instanceof ProblemError && error.problem.status !== 401) {
    dispatch({ type: "refused", revision, problem: error.problem });
    return;
  }
  dispatch({ type: "gave-up", revision });
  notice.value = { kind: "bad", text: error instanceof InvalidDraft ? `In the request, ${error.message}.` : failed(error) };
}

/** What an error says of single fields, by their path in the request. */
function faultsOf(error: unknown): Readonly<Record<string, string>> {
  if (error instanceof InvalidDraft) return { [error.path]: error.message };
  if (!(error instanceof ProblemError)) return {};
  return Object.fromEntries((error.problem.errors ?? []).map(({ field, reason }) => [field, reason]));
}

/** Loads the curves of a plan, which the page draws where that plan is on the screen. */
export async function loadCurves(planId: string): Promise<void> {
  if (curves.peek()?.planId === planId) return;
  try {
    const value = await get<Curves>(`/plans/${planId}/curves`, { patient: true });
    if (shownId.peek() === planId) curves.value = { planId, value };
  } catch {
    // the curves of the trajectory are drawn without them
  }
}

// Dragging: one preview is under way at most, and only the newest request is asked next.
let wanted: Draft | null = null;
let asking = false;
let generation = 0;

/** Edits the request and asks for a fast preview of it; the latest one wins. */
export function drag(fields: Partial<Draft>): void {
  edit(fields);
  wanted = state.value.request;
  if (!asking) void askPreviews();
}

function stopPreview(): void {
  generation += 1;
  wanted = null;
}

async function askPreviews(): Promise<void> {
  asking = true;
  while (wanted !== null) {
    const draft = wanted;
    const mine = generation;
    wanted = null;
    const { cell } = state.value;
    if (cell === null) break;
    try {
      const answer = await call("POST", "/plan?store=false", { body: previewOf(draft, cell, controllerTime()), patient: true });
      const preview = (await answer.json()) as Plan;
      if (mine === generation) dispatch({ type: "preview", plan: preview });
    } catch (error) {
      if (mine !== generation) continue;
      dispatch({ type: "preview", plan: null });
      if (error instanceof ProblemError && draft === state.value.request) {
        dispatch({ type: "refused", revision: state.value.revision, problem: error.problem });
      }
    }
  }
  asking = false;
}

/** The end of a drag: the full answer. */
export function drop(fields: Partial<Draft>): void {
  edit(fields);
  void plan();
}

export function takeNearest(): void {
  const nearest = state.value.problem?.value.nearest;
  if (!nearest) return;
  dispatch({ type: "edit", request: withNearest(state.value.request, nearest) });
  void plan();
}

/** Throws the plan on the screen; refuses where it is not the answer to the request on the screen. */
export async function execute(mode: ExecutionMode, dryRun: boolean): Promise<void> {
  const now = state.value;
  if (!armed.value || now.plan === null || now.cell === null) return;
  notice.value = null;
  playing.value = 0;
  try {
    await start(now.plan.value.id, mode, dryRun);
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}

/** Begins an execution. A stop that was pressed while the request was under way may have found nothing: it is sent again. */
export async function start(planId: string, mode: ExecutionMode, dryRun: boolean): Promise<Execution> {
  const before = stops;
  const execution = await post<Execution>("/execute", { plan_id: planId, mode, dry_run: dryRun }, { key: newKey() });
  reached();
  dispatch({ type: "execution", execution });
  if (stops !== before) void stop();
  return execution;
}

/** A key that makes a repeated request harmless. */
function newKey(): string {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

const STOP_AGAIN_MS = 500; // after a stop that did not get through
const STOP_TRIES_MS = 30_000; // a person has used the emergency stop long since
let stops = 0; // pressed so far: a newer one takes the place of an older one

/** Brakes whatever runs on the cell on the screen, whoever started it; where nothing runs, it says so unless `quiet`. */
export async function stop(quiet = false): Promise<void> {
  driving.value?.abort.abort();
  const { cell } = state.value;
  if (cell === null) return;
  if (!quiet) playing.value = 0;
  const mine = ++stops;
  const ends = performance.now() + STOP_TRIES_MS;
  const known = runningId(cell);
  while (!(await sendStop(cell, known, quiet))) {
    if (performance.now() > ends) return;
    await new Promise((resume) => setTimeout(resume, STOP_AGAIN_MS));
    if (mine !== stops || (known !== null && isOver(known))) return;
  }
}

/** What is known to run: a stop then needs no question before it. */
function runningId(cell: string): string | null {
  const { execution } = state.value;
  if (execution !== null && execution.state !== "finished") return execution.id;
  return cellStates.value[cell]?.execution_id ?? null;
}

/** Whether an execution has ended, as far as is seen. */
export function isOver(id: string): boolean {
  return state.value.execution?.id === id && state.value.execution.state === "finished";
}

/** Sends a stop once; returns whether nothing is left to be sent. */
async function sendStop(cell: string, known: string | null, quiet: boolean): Promise<boolean> {
  let id = known;
  try {
    id ??= (await get<CellState>(`/cells/${cell}/state`)).execution_id;
    if (id === null) {
      if (!quiet) notice.value = { kind: "good", text: `Nothing is running on ${cell}.` };
      return true;
    }
    playing.value = 0;
    dispatch({ type: "stopping", id });
    dispatch({ type: "execution", execution: await post<Execution>(`/executions/${id}/abort`) });
    reached();
    notice.value = { kind: "good", text: `Stop was sent to ${cell}.` };
    return true;
  } catch (error) {
    if (id !== null && isOver(id)) return true;
    const isTriedAgain = !quiet && (error instanceof ConnectionLost || (error instanceof ProblemError && error.problem.status >= 500));
    const again = isTriedAgain ? "; it is sent again" : "";
    notice.value = { kind: "bad", text: `Stop did not get through${again}: ${failed(error)} Use the emergency stop.`, stopOf: id };
    return !isTriedAgain;
  }
}

export async function acknowledge(cell: string): Promise<void> {
  try {
    await post(`/cells/${cell}/acknowledge`);
    notice.value = { kind: "good", text: `${cell}: acknowledged. The executor looks at the robot again.` };
    await refreshCell(cell);
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}

export async function refreshCell(cell: string): Promise<CellState> {
  const answer = await get<CellState>(`/cells/${cell}/state`);
  cellStates.value = { ...cellStates.value, [cell]: answer };
  const told_s = answer.executor?.alive ? answer.robot?.timestamp_s : null;
  if (typeof told_s === "number") clockLeads.value = { ...clockLeads.value, [cell]: told_s + answer.executor!.heartbeat_age_s - Date.now() / 1000 };
  return answer;
}

/** Where the robot stands now, for "from here" [rad]; null where no executor reports it. */
export async function currentPositions(): Promise<readonly number[] | null> {
  const { cell } = state.value;
  if (cell === null) return null;
  try {
    const robot = (await refreshCell(cell)).robot as { positions?: number[] } | null;
    if (robot?.positions) return robot.positions;
    notice.value = { kind: "bad", text: `No executor reports where the arm of ${cell} stands.` };
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
  return null;
}

/** Reports what a person saw of the landing of an execution; asks first where that is far from its plan. */
export async function reportLanding(id: string, report: LandingRequest): Promise<void> {
  picking.value = null;
  const plan = planOfRun(id);
  const distance_m = doubtfulDistance(report, plan);
  if (distance_m !== null) {
    doubt.value = { id, report, distance_m };
    return;
  }
  await sendReport(id, report);
}

/** Sends the report that was doubted, or lets it be. */
export async function settleDoubt(isMeant: boolean): Promise<void> {
  const asked = doubt.value;
  doubt.value = null;
  if (isMeant && asked !== null) await sendReport(asked.id, asked.report);
}

function planOfRun(id: string): Plan | null {
  const run = state.value.execution;
  return run?.id === id && runPlan.value?.id === run.planId ? runPlan.value : null;
}

async function sendReport(id: string, report: LandingRequest): Promise<void> {
  try {
    const kept = await post<LandingAnswer>(`/executions/${id}/landing`, report, { key: newKey() });
    landings.value = { ...landings.value, [id]: [...(landings.value[id] ?? []), kept] };
    notice.value = { kind: "good", text: `Reported for the throw${ofRun(id)}: ${landingWords(kept)}.` };
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}

/** When a throw was, and where it was to land. */
function ofRun(id: string): string {
  const run = state.value.execution;
  if (run?.id !== id || run.createdAt === null) return "";
  const aim = aimOf(planOfRun(id) ?? ({ request: {} } as Plan));
  return ` of ${dateWords(run.createdAt)}${aim ? ` to ${placeWords(aim, floorZ.value)}` : ""}`;
}

/** Takes back a report that was wrong; it stays listed, and counts nowhere. */
export async function withdrawLanding(id: string, landing: string): Promise<void> {
  try {
    const gone = await post<LandingAnswer>(`/executions/${id}/landing/${landing}/withdraw`);
    const known = landings.value[id] ?? [];
    landings.value = { ...landings.value, [id]: known.map((each) => (each.id === landing ? gone : each)) };
    notice.value = { kind: "good", text: `Withdrawn: ${landingWords(gone)}. Estimate a profile anew where one rests on it.` };
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}

/** Reports a landing at the place on the floor that was pointed at [m]. */
export async function reportPointedAt(position: readonly number[]): Promise<void> {
  const id = picking.value;
  if (id === null) return;
  try {
    await reportLanding(id, placeReport(position.map((x) => x.toFixed(4)), landingStd.value));
  } catch (error) {
    notice.value = { kind: "bad", text: `In the report, ${(error as InvalidDraft).message}.` };
  }
}

/** Begins a throwability map of the cell, or goes on with the same one where that was ended. */
export async function makeMap(request: MapRequest): Promise<void> {
  const { cell } = state.value;
  if (cell === null) return;
  try {
    await post(`/cells/${cell}/map`, request, { patient: true });
    await loadMap();
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}

export async function cancelMap(id: string): Promise<void> {
  try {
    await post(`/cells/${state.value.cell}/map/cancel?id=${id}`);
    await loadMap();
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}

/** Loads the map of the cell; there may be none. */
export async function loadMap(): Promise<void> {
  const { cell } = state.value;
  if (cell === null) return;
  let found: ThrowMap | null = null;
  try {
    found = await get<ThrowMap>(`/cells/${cell}/map`, { patient: true });
  } catch (error) {
    if (!(error instanceof ProblemError && error.problem.status === 404)) throw error;
  }
  if (cell === state.value.cell && !isSameMap(found, throwMap.value)) throwMap.value = found;
}

/** Whether nothing has been added to a map. */
function isSameMap(a: ThrowMap | null, b: ThrowMap | null): boolean {
  if (a === null || b === null) return a === b;
  return a.id === b.id && a.state === b.state && a.level_m === b.level_m && a.progress.done === b.progress.done;
}

export async function learn(): Promise<void> {
  await changeProfiles(() => post(`/cells/${state.value.cell}/profiles`, undefined, { patient: true }), "A profile was estimated. It is not in use yet.");
}

export async function adopt(id: string): Promise<void> {
  await use(() => post(`/profiles/${id}/adopt`), "The cell uses this profile from now on.");
}

export async function revert(): Promise<void> {
  await use(() => post(`/cells/${state.value.cell}/profiles/revert`), "The cell uses its file's numbers again.");
}

/** Changes what the cell uses. A plan of another profile is not executable: the request has to be planned again. */
async function use(request: () => Promise<unknown>, text: string): Promise<void> {
  if (await changeProfiles(request, text)) dispatch({ type: "edit", request: state.value.request });
}

/** Returns whether the request was carried out. */
async function changeProfiles(request: () => Promise<unknown>, text: string): Promise<boolean> {
  const { cell } = state.value;
  if (cell === null) return false;
  try {
    await request();
    await loadProfiles(cell);
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
    return false;
  }
  notice.value = { kind: "good", text };
  return true;
}

export async function loadProfiles(cell: string): Promise<void> {
  const list = await get<ProfileList>(`/cells/${cell}/profiles`);
  if (cell === state.value.cell && JSON.stringify(list) !== JSON.stringify(profiles.value)) profiles.value = list;
}

/** Keeps a token for this tab and tries it. */
export async function useToken(value: string): Promise<void> {
  keepToken(value);
  try {
    await get("/cells");
    reached();
  } catch (error) {
    failed(error);
    access.value = token() ? "token-refused" : "token-needed";
  }
}
