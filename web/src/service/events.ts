// Server-sent events of executions and searches. `fetch` instead of EventSource, which can send neither token nor body.

import { authorization, call, ConnectionLost, ProblemError } from "./client";
import type { Plan, PlanProgress, PlanRequest, ProblemDocument } from "./types";

interface ServerEvent {
  readonly id: number;
  readonly kind: string; // state, telemetry; progress, plan, problem
  readonly data: Record<string, unknown>;
}

const RETRY_MS = 500;

/** Splits a stream's text into its events; returns them and the unfinished rest. */
export function parseEvents(text: string): { events: ServerEvent[]; rest: string } {
  const blocks = text.split("\n\n");
  const rest = blocks.pop() ?? "";
  const events: ServerEvent[] = [];
  for (const block of blocks) {
    const fields = new Map(block.split("\n").map((line) => splitLine(line)));
    const data = fields.get("data");
    if (data === undefined) continue;
    events.push({ id: Number(fields.get("id")), kind: fields.get("event") ?? "message", data: JSON.parse(data) });
  }
  return { events, rest };
}

function splitLine(line: string): [string, string] {
  const colon = line.indexOf(":");
  return colon < 0 ? [line, ""] : [line.slice(0, colon), line.slice(colon + 1).trimStart()];
}

/** Yields the events of an execution until it has ended or `signal` aborts; resumes after a lost connection. */
export async function* watchExecution(id: string, signal: AbortSignal): AsyncGenerator<ServerEvent> {
  let last = 0;
  while (!signal.aborted) {
    try {
      const headers = { ...authorization(), "Last-Event-ID": String(last) };
      const response = await fetch(`/executions/${id}/events`, { headers, signal, cache: "no-store" });
      if (!response.ok || response.body === null) {
        if (response.status < 500) return;
        throw new Error(`status ${response.status}`);
      }
      for await (const event of eventsOf(response.body)) {
        last = event.id;
        yield event;
        if (event.kind === "state" && event.data["state"] === "finished") return;
      }
    } catch {
      if (signal.aborted) return;
    }
    await new Promise((resume) => setTimeout(resume, RETRY_MS));
  }
}

/** Returns the plan for a request; tells of its search, which ends with `signal`. */
export async function planned(request: PlanRequest, onProgress: (progress: PlanProgress) => void, signal: AbortSignal): Promise<Plan> {
  const response = await call("POST", "/plan", { body: request, accept: "text/event-stream", signal });
  try {
    for await (const { kind, data } of eventsOf(response.body!)) {
      if (kind === "plan") return data as unknown as Plan;
      if (kind === "problem") throw new ProblemError(data as unknown as ProblemDocument);
      onProgress(data as unknown as PlanProgress);
    }
  } catch (error) {
    if (error instanceof ProblemError) throw error;
  }
  throw new ConnectionLost();
}

async function* eventsOf(body: ReadableStream<Uint8Array>): AsyncGenerator<ServerEvent> {
  const reader = body.pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>).getReader();
  let text = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const { events, rest } = parseEvents(text + value);
    text = rest;
    yield* events;
  }
}
