// Client of the service: JSON requests that turn problems into errors. The token is kept for this tab only.

import type { ProblemDocument } from "./types";

const TOKEN_KEY = "fling-token";
const PATIENCE_MS = 5000; // for everything but a plan, which takes its time: a frozen service counts as lost

/** A refusal in words: an `application/problem+json` of the service. */
export class ProblemError extends Error {
  constructor(readonly problem: ProblemDocument) {
    super(problem.detail || problem.title);
  }
}

/** The service did not answer at all. */
export class ConnectionLost extends Error {
  constructor() {
    super("The service does not answer.");
  }
}

export function token(): string {
  return sessionStorage.getItem(TOKEN_KEY) ?? "";
}

export function keepToken(value: string): void {
  if (value) sessionStorage.setItem(TOKEN_KEY, value);
  else sessionStorage.removeItem(TOKEN_KEY);
}

/** Returns the header that carries the token; empty without one. */
export function authorization(): Record<string, string> {
  const value = token();
  return value ? { Authorization: `Bearer ${value}` } : {};
}

interface CallOptions {
  readonly body?: unknown;
  readonly accept?: string;
  readonly key?: string; // Idempotency-Key
  readonly patient?: boolean; // wait as long as it takes
  readonly signal?: AbortSignal; // waits until a person has enough of it
}

/** Sends one request. Throws ProblemError for a refusal, ConnectionLost where nothing answers. */
export async function call(method: string, path: string, options: CallOptions = {}): Promise<Response> {
  const headers: Record<string, string> = authorization();
  if (options.body !== undefined) headers["Content-Type"] = "application/json";
  if (options.accept) headers["Accept"] = options.accept;
  if (options.key) headers["Idempotency-Key"] = options.key;
  const init: RequestInit = { method, headers, cache: "no-store" };
  if (options.body !== undefined) init.body = JSON.stringify(options.body);
  if (options.signal) init.signal = options.signal;
  else if (!options.patient) init.signal = AbortSignal.timeout(PATIENCE_MS);
  let response: Response;
  try {
    response = await fetch(path, init);
  } catch {
    throw new ConnectionLost();
  }
  if (response.ok) return response;
  throw new ProblemError(await problemOf(response));
}

export async function get<T>(path: string, options: CallOptions = {}): Promise<T> {
  return (await (await call("GET", path, options)).json()) as T;
}

export async function post<T>(path: string, body?: unknown, options: CallOptions = {}): Promise<T> {
  if (body !== undefined) options = { ...options, body };
  return (await (await call("POST", path, options)).json()) as T;
}

async function problemOf(response: Response): Promise<ProblemDocument> {
  const type = response.headers.get("Content-Type") ?? "";
  if (type.includes("json")) return (await response.json()) as ProblemDocument;
  const title = response.status >= 500 ? "The service failed" : "The service refused";
  return { type: "about:blank", title, status: response.status, detail: `${title} (status ${response.status}).` };
}
