// Pages of past throws: which are listed, and how they are asked for.

import { signal } from "@preact/signals";

import { get } from "../service/client";
import type { Execution, ExecutionList } from "../service/types";
import { loadPasts } from "./follow";
import { cellName, failed, history, notice } from "./store";

export const ROWS = 10;

interface Page {
  readonly cell: string;
  readonly outcome: string; // empty: of all
  readonly before: readonly string[]; // cursors of the pages from the first to this one; empty: the newest
  readonly runs: readonly Execution[];
  readonly next: string | null;
}

/** A page that was asked for; null: the newest throws, which are followed. */
const page = signal<Page | null>(null);

/** What the list shows now; null while nothing is known. */
export function listed(): Page | null {
  const cell = cellName.value;
  if (cell === null) return null;
  const asked = page.value;
  if (asked !== null && asked.cell === cell) return asked;
  const all = history.value;
  if (all === null) return null;
  const runs = all.filter((run) => run.cell === cell).slice(0, ROWS);
  return { cell, outcome: "", before: [], runs, next: all.length > ROWS ? (runs.at(-1)?.id ?? null) : null };
}

export async function filterBy(outcome: string): Promise<void> {
  await ask(outcome, []);
}

export async function older(): Promise<void> {
  const shown = listed();
  if (shown?.next) await ask(shown.outcome, [...shown.before, shown.next]);
}

export async function newer(): Promise<void> {
  const shown = listed();
  if (shown) await ask(shown.outcome, shown.before.slice(0, -1));
}

async function ask(outcome: string, before: readonly string[]): Promise<void> {
  const cell = cellName.value;
  if (cell === null) return;
  if (outcome === "" && before.length === 0) {
    page.value = null;
    return;
  }
  const query = new URLSearchParams({ cell, limit: String(ROWS) });
  if (outcome) query.set("outcome", outcome);
  if (before.length > 0) query.set("cursor", before.at(-1)!);
  try {
    const answer = await get<ExecutionList>(`/executions?${query}`);
    page.value = { cell, outcome, before, runs: answer.executions, next: answer.next_cursor };
    await loadPasts(answer.executions);
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}
