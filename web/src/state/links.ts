// Addresses of plans and executions, and what a tab keeps of its form over a reload. Pure but for the tab's storage.

import type { PlanRequest } from "../service/types";
import { type Draft, FIRST_DRAFT } from "./draft";

/** What an address names. */
export interface Link {
  readonly kind: "plan" | "execution";
  readonly id: string;
}

const ADDRESS = /^#\/(plan|execution)\/([0-9a-f-]{36})$/i;

export function linkOf(hash: string): Link | null {
  const found = ADDRESS.exec(hash);
  return found ? { kind: found[1] as Link["kind"], id: found[2]! } : null;
}

export function hashOf({ kind, id }: Link): string {
  return `#/${kind}/${id}`;
}

/** Whether two requests ask for the same: fields that are left out have their defaults. */
export function isSameRequest(a: PlanRequest, b: PlanRequest): boolean {
  return JSON.stringify(normal(a)) === JSON.stringify(normal(b));
}

const DEFAULTS: Readonly<Record<string, unknown>> = { frame: "world", backend: "auto", start: null, limits: null };

/** Returns a value with sorted keys, without what is null, empty or a default. */
function normal(value: unknown): unknown {
  if (Array.isArray(value)) return value.map(normal);
  if (value === null || typeof value !== "object") return value;
  const entries = Object.entries(value)
    .map(([key, part]) => [key, normal(part)] as const)
    .filter(([key, part]) => part !== null && part !== undefined && DEFAULTS[key] !== part && !isEmpty(part));
  return Object.fromEntries(entries.sort(([a], [b]) => (a < b ? -1 : 1)));
}

function isEmpty(value: unknown): boolean {
  return typeof value === "object" && value !== null && !Array.isArray(value) && Object.keys(value).length === 0;
}

const DRAFT_KEY = "fling-draft";

interface Kept {
  readonly cell: string;
  readonly draft: Draft;
}

/** Keeps the form for this tab. */
export function keepDraft(kept: Kept): void {
  sessionStorage.setItem(DRAFT_KEY, JSON.stringify(kept));
}

/** Returns the form that this tab kept; null without one. */
export function keptDraft(): Kept | null {
  try {
    const kept = JSON.parse(sessionStorage.getItem(DRAFT_KEY) ?? "null") as Kept | null;
    return kept && { ...kept, draft: { ...FIRST_DRAFT, ...kept.draft } }; // an older page kept fewer fields
  } catch {
    return null;
  }
}
