// The newest job of the chosen cell: how far it is, what became of its objects, and what a person asks of it.

import { signal } from "@preact/signals";

import { call, get } from "../service/client";
import { save } from "../service/save";
import type { Job, JobList, ObjectResult, ObjectResultList } from "../service/types";
import { cellName, failed, notice } from "./store";

export type JobAction = "pause" | "resume" | "cancel";

/** A job and the objects about the current one. */
interface ShownJob {
  readonly job: Job;
  readonly objects: readonly ObjectResult[];
}

/** null: the cell has none, or nothing is known yet. */
export const shownJob = signal<ShownJob | null>(null);

const LISTED = 50; // newest jobs among which the cell's is looked for
const OBJECTS = 200; // that the page loads, the limit of the service
const AHEAD = 50; // of them that are still to come

/** Loads the newest job of the cell; one that is finished is loaded once. */
export async function followJob(): Promise<void> {
  const cell = cellName.value;
  const list = await get<JobList>(`/jobs?limit=${LISTED}`);
  const newest = list.jobs.find((job) => job.cell === cell);
  if (newest === undefined) {
    shownJob.value = null;
    return;
  }
  const known = shownJob.value?.job;
  if (known?.id === newest.id && known.state === "finished" && newest.state === "finished") return;
  const job = await get<Job>(`/jobs/${newest.id}`);
  const before = Math.max(0, Math.min(job.done + AHEAD, job.total) - OBJECTS);
  const results = await get<ObjectResultList>(`/jobs/${newest.id}/results?limit=${OBJECTS}&cursor=${before - 1}`);
  if (cell === cellName.value) shownJob.value = { job, objects: results.results };
}

export async function askOfJob(id: string, action: JobAction): Promise<void> {
  try {
    await call("POST", `/jobs/${id}/${action}`);
    await followJob();
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}

export async function saveResults(id: string, media: string, suffix: string): Promise<void> {
  try {
    const response = await call("GET", `/jobs/${id}/results`, { accept: media });
    save(await response.blob(), `${id}.${suffix}`);
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}
