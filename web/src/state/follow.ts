// What the page follows by itself: the cells, the robot of the chosen one, whatever runs on it, its past throws.

import { effect } from "@preact/signals";

import { get } from "../service/client";
import { watchExecution } from "../service/events";
import type { CellList, CellModel, Execution, ExecutionList, LandingList, Plan, PlanRequest } from "../service/types";
import { isOver, loadCurves, loadMap, loadProfiles, nameInAddress, refreshCell } from "./actions";
import { type Draft, draftOf, requestOf } from "./draft";
import { isSameRequest, keepDraft, keptDraft, linkOf } from "./links";
import { followJob, shownJob } from "./job";
import { isRunning } from "./machine";
import {
  cellName, cells, dispatch, endTime, execution, failed, history, landings, mapShown, model, notice, playing, reached, running, runPlan, shownId, state, strayed,
  targets, throwMap, time, viewing,
} from "./store";

const ROBOT_MS = 400; // state of the chosen cell
const MODEL_AGAIN_MS = 3000; // after a model could not be read
const CELLS_MS = 2500; // the list, the other cells and the past
const MAP_MS = 2000; // the map, while it is shown
const JOB_MS = 2000; // how far the cell's job is
const HISTORY = 40; // executions that are listed
const AT_ONCE = 5; // requests for them; a browser has six connections

/** Starts following; never ends. */
export function follow(): void {
  void openAddress();
  addEventListener("hashchange", () => void followLink());
  effect(() => {
    const { cell, request } = state.value;
    if (cell !== null) keepDraft({ cell, draft: request });
  });
  void repeat(CELLS_MS, followCells);
  void repeat(ROBOT_MS, followRobot);
  void repeat(CELLS_MS, followHistory);
  void repeat(MAP_MS, followMap);
  void repeat(JOB_MS, followJob);
  effect(() => {
    throwMap.value = null; // these are of another cell
    history.value = null;
    shownJob.value = null;
    viewing.value = null;
    void loadModel(cellName.value);
  });
  effect(() => {
    if (shownId.value) void loadCurves(shownId.value);
  });
  effect(() => {
    const beside = strayed.value;
    if (beside === null) return;
    const isSame = beside.cell === cellName.value && beside.shown === shownId.value && beside.time === time.value;
    if (!isSame || playing.value !== 0) strayed.value = null;
  });
  effect(() => {
    const said = notice.value?.stopOf; // the stop is over, however it came to be
    if (said && execution.value?.id === said && execution.value.state === "finished") notice.value = null;
  });
  followRuns();
}

async function repeat(period: number, step: () => Promise<void>): Promise<never> {
  for (;;) {
    try {
      await step();
    } catch (error) {
      failed(error);
    }
    await new Promise((resume) => setTimeout(resume, period));
  }
}

async function followCells(): Promise<void> {
  const list = (await get<CellList>("/cells")).cells;
  reached();
  if (JSON.stringify(list.map(fixed)) !== JSON.stringify((cells.value ?? []).map(fixed))) cells.value = list;
  if (!list.some((known) => known.name === state.value.cell)) {
    const first = list.find((known) => known.default && !known.error) ?? list.find((known) => !known.error);
    if (first) dispatch({ type: "cell", name: first.name });
  }
  for (const known of list) {
    if (known.name !== state.value.cell && known.executor && !known.error) await refreshCell(known.name);
  }
}

/** What the list shows of a cell; its heartbeat's age alone is no reason to draw it anew. */
function fixed(known: CellList["cells"][number]): unknown {
  return { ...known, executor: known.executor && { alive: known.executor.alive, read_only: known.executor.read_only } };
}

async function followRobot(): Promise<void> {
  const { cell } = state.value;
  if (cell === null) return;
  const answer = await refreshCell(cell);
  reached();
  if (answer.execution_id !== null) dispatch({ type: "runs", cell, id: answer.execution_id });
  // An executor that is gone ends no event stream: what the store says of the execution counts.
  const { execution } = state.value;
  if (execution !== null && isRunning(state.value) && answer.execution_id !== execution.id) await readExecution(execution.id);
}

async function readExecution(id: string): Promise<void> {
  dispatch({ type: "execution", execution: await get<Execution>(`/executions/${id}`) });
}

async function followHistory(): Promise<void> {
  const { cell } = state.value;
  if (cell === null) return;
  const page = await get<ExecutionList>(`/executions?cell=${encodeURIComponent(cell)}&limit=${HISTORY}`);
  if (cell !== state.value.cell) return;
  if (JSON.stringify(page.executions) !== JSON.stringify(history.value)) history.value = page.executions;
  await loadPasts(page.executions);
  await loadProfiles(cell);
}

/** Loads targets and landings of executions that have ended. */
export async function loadPasts(runs: readonly Execution[]): Promise<void> {
  await inParallel(runs.filter((run) => run.state === "finished"), loadPast);
}

/** Does something with every item, a few at a time. */
async function inParallel<T>(items: readonly T[], work: (item: T) => Promise<void>): Promise<void> {
  const rest = [...items];
  const worker = async (): Promise<void> => {
    for (let item = rest.shift(); item !== undefined; item = rest.shift()) await work(item);
  };
  await Promise.all(Array.from({ length: AT_ONCE }, worker));
}

async function loadPast(run: Execution): Promise<void> {
  if (landings.value[run.id] === undefined) {
    const list = (await get<LandingList>(`/executions/${run.id}/landing`)).landings;
    landings.value = { ...landings.value, [run.id]: list };
  }
  if (targets.value[run.plan_id] === undefined) {
    const plan = await get<Plan>(`/plans/${run.plan_id}?trajectory=false`);
    targets.value = { ...targets.value, [run.plan_id]: plan };
  }
}

/** The map sharpens while it is made; one that is finished changes only with cell and profile. */
async function followMap(): Promise<void> {
  if (mapShown.value && cellName.value !== null) await loadMap();
}

async function loadModel(cell: string | null): Promise<void> {
  model.value = null;
  if (cell === null) return;
  try {
    const answer = await get<CellModel>(`/cells/${cell}/model`);
    if (state.value.cell === cell) model.value = answer;
  } catch (error) {
    failed(error);
    setTimeout(() => state.value.cell === cell && model.value === null && void loadModel(cell), MODEL_AGAIN_MS);
  }
}

let followed: { id: string; abort: AbortController } | null = null;

/** Follows the events of whatever runs on the chosen cell. */
function followRuns(): void {
  effect(() => {
    const run = state.value.execution;
    const id = run !== null && run.state !== "finished" ? run.id : null;
    if (id === null || followed?.id === id) {
      if (run === null && followed) endFollowing();
      return;
    }
    endFollowing();
    followed = { id, abort: new AbortController() };
    void followRun(id, followed.abort.signal).catch(failed);
  });
}

function endFollowing(): void {
  followed?.abort.abort();
  followed = null;
}

async function followRun(id: string, signal: AbortSignal): Promise<void> {
  playing.value = time.value = 0;
  strayed.value = null;
  viewing.value = null;
  nameInAddress({ kind: "execution", id });
  void showExecution(id).catch(failed);
  for await (const { kind, data } of watchExecution(id, signal)) {
    dispatch({ type: "event", id, kind, data });
    const clock = data["clock_s"];
    if (kind === "telemetry" && typeof clock === "number" && running.value) time.value = Math.min(endTime.value, Math.max(0, clock));
  }
  if (signal.aborted) return;
  await readExecution(id);
  const ended = state.value.execution?.id === id ? state.value.execution : null;
  if (ended?.planId !== shownId.value) time.value = 0; // another plan is shown again
  if (ended !== null && ended.outcome !== "completed")
    strayed.value = { cell: cellName.value, shown: shownId.value, time: time.value, released: ended.metrics?.["released"] === true };
  else if (time.value > 0 && time.value < endTime.value && !ended?.dryRun) playing.value = 1; // the object is still in the air
  const { [id]: _, ...others } = landings.value;
  landings.value = others;
  await followHistory();
}

/** Shows an execution, with its plan; one that runs stays on the screen. */
async function showExecution(id: string): Promise<void> {
  const execution = await get<Execution>(`/executions/${id}`);
  dispatch({ type: "execution", execution });
  const plan = await planOf(execution);
  if (state.value.execution?.id === id) runPlan.value = plan;
}

async function planOf(execution: Execution): Promise<Plan> {
  const known = state.value.plan?.value;
  return known?.id === execution.plan_id ? known : get<Plan>(`/plans/${execution.plan_id}`);
}

/** Shows a past execution instead of the plan, unless something runs. */
export async function showPast(id: string): Promise<void> {
  await showExecution(id);
  if (state.value.execution?.id !== id) return;
  playing.value = time.value = 0;
  viewing.value = id;
  nameInAddress({ kind: "execution", id });
}

/** Comes back to what the address names: a plan with its request, or an execution with both. */
export async function openAddress(): Promise<void> {
  const link = linkOf(location.hash);
  const kept = keptDraft();
  try {
    if (link === null) {
      if (kept !== null) dispatch({ type: "restored", cell: kept.cell, request: kept.draft, plan: null, answers: false });
      return;
    }
    const execution = link.kind === "execution" ? await get<Execution>(`/executions/${link.id}`) : null;
    const plan = await get<Plan>(`/plans/${execution?.plan_id ?? link.id}`, { patient: true });
    restore(plan, kept?.cell === plan.cell ? kept.draft : null);
    if (execution === null) return;
    dispatch({ type: "execution", execution });
    if (state.value.execution?.id !== execution.id) return; // something else runs, and stays on the screen
    runPlan.value = plan;
    if (isOver(execution.id)) viewing.value = execution.id;
  } catch (error) {
    notice.value = { kind: "bad", text: `What this address names could not be shown. ${failed(error)}` };
  }
}

/** Goes to an address that was clicked or typed: a past throw of this cell leaves plan and form as they are. */
async function followLink(): Promise<void> {
  const link = linkOf(location.hash);
  if (link === null) return;
  try {
    if (link.kind === "plan") return takeRequest(await get<Plan>(`/plans/${link.id}`, { patient: true }));
    const execution = await get<Execution>(`/executions/${link.id}`);
    if (execution.cell === state.value.cell) await showPast(link.id);
    else await openAddress();
  } catch (error) {
    notice.value = { kind: "bad", text: `What this address names could not be shown. ${failed(error)}` };
  }
}

/** Brings back a plan with a form: the tab's own, else that of the plan's request. */
function restore(plan: Plan, own: Draft | null): void {
  const asked = plan.request as unknown as PlanRequest;
  const stated = draftOf(asked);
  const request = own ?? stated;
  // The form has no fields for some of what a motion may ask for: its plan answers it until it is edited.
  const answers = asked.passages ? JSON.stringify(request) === JSON.stringify(stated) : answersTo(request, plan.cell, asked);
  dispatch({ type: "restored", cell: plan.cell, request, plan, answers });
}

/** Whether a form asks for exactly what a plan was made for. */
function answersTo(request: Draft, cell: string, asked: PlanRequest): boolean {
  try {
    return isSameRequest({ ...requestOf(request, cell), cell: null }, { ...asked, cell: null });
  } catch {
    return false; // text that is no number
  }
}

/** Puts the request of a plan into the form. */
export function takeRequest(plan: Plan): void {
  viewing.value = null;
  time.value = 0;
  restore(plan, null);
  nameInAddress({ kind: "plan", id: plan.id });
}

