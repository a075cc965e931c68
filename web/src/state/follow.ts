// What the page follows by itself: the cells, the robot of the chosen one, whatever runs on it, its past throws.

import { effect } from "@preact/signals";

import { get } from "../service/client";
import { watchExecution } from "../service/events";
import type { CellList, CellModel, Execution, ExecutionList, LandingList, Plan, ProfileList } from "../service/types";
import { loadCurves, loadMap, refreshCell } from "./actions";
import { isRunning } from "./machine";
import {
  cellName, cells, dispatch, endTime, failed, history, landings, mapShown, model, playing, profiles, reached, running, runPlan, shownId, state, strayed,
  targets, throwMap, time,
} from "./store";

const ROBOT_MS = 400; // state of the chosen cell
const MODEL_AGAIN_MS = 3000; // after a model could not be read
const CELLS_MS = 2500; // the list, the other cells and the past
const MAP_MS = 2000; // the map, while it is shown
const HISTORY = 40; // executions that are listed
const AT_ONCE = 5; // requests for them; a browser has six connections

/** Starts following; never ends. */
export function follow(): void {
  void repeat(CELLS_MS, followCells);
  void repeat(ROBOT_MS, followRobot);
  void repeat(CELLS_MS, followHistory);
  void repeat(MAP_MS, followMap);
  effect(() => {
    throwMap.value = null; // that of another cell
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
  if (state.value.cell === null) {
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
  const page = await get<ExecutionList>(`/executions?limit=${HISTORY}`);
  if (JSON.stringify(page.executions) !== JSON.stringify(history.value)) history.value = page.executions;
  const own = page.executions.filter((run) => run.cell === cell && run.state === "finished");
  await inParallel(own.slice(0, HISTORY), loadPast);
  if (cell !== null) {
    const list = await get<ProfileList>(`/cells/${cell}/profiles`);
    if (JSON.stringify(list) !== JSON.stringify(profiles.value)) profiles.value = list;
  }
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
  void showExecution(id).catch(failed);
  for await (const { kind, data } of watchExecution(id, signal)) {
    dispatch({ type: "event", id, kind, data });
    const clock = data["clock_s"];
    if (kind === "telemetry" && typeof clock === "number" && running.value) time.value = Math.max(0, clock);
  }
  if (signal.aborted) return;
  await readExecution(id);
  const ended = state.value.execution?.id === id ? state.value.execution : null;
  if (ended?.planId !== shownId.value) time.value = 0; // another plan is shown again
  if (ended !== null && ended.outcome !== "completed")
    strayed.value = { cell: cellName.value, shown: shownId.value, time: time.value, released: ended.metrics?.["released"] === true };
  else if (time.value > 0 && time.value < endTime.value) playing.value = 1; // the object is still in the air
  const { [id]: _, ...others } = landings.value;
  landings.value = others;
  await followHistory();
}

/** Shows an execution, with its plan; one that runs stays on the screen. */
export async function showExecution(id: string): Promise<void> {
  const execution = await get<Execution>(`/executions/${id}`);
  dispatch({ type: "execution", execution });
  const known = state.value.plan?.value;
  const plan = known?.id === execution.plan_id ? known : await get<Plan>(`/plans/${execution.plan_id}`);
  runPlan.value = plan;
}

