// Whether a cell's arm can be moved now, and whether that arm is a simulation. Pure.

import type { CellState, CellSummary } from "../service/types";

const LOOPBACK = /^(localhost|127(\.\d+){3}|\[?::1\]?)$/;

/** What stands at a cell's link: `unproven` calls itself a simulation, and is not on this machine. */
export type ArmKind = "real" | "simulated" | "unproven";

export function armKind({ link_kind, link_host }: CellSummary): ArmKind {
  if (link_kind === "ur") return "real";
  return link_host === null || link_host === undefined || LOOPBACK.test(link_host) ? "simulated" : "unproven";
}

interface Circumstances {
  readonly lost: boolean; // the service does not answer
  readonly asksToken: boolean;
  readonly summary: CellSummary | null;
  readonly live: CellState | null;
}

/** Returns why an execution would not start now, in words; null where nothing is known to be in its way. */
export function obstacleOf({ lost, asksToken, summary, live }: Circumstances): string | null {
  if (lost) return "The service does not answer.";
  if (asksToken) return "The service asks for a token.";
  if (summary === null) return "There is no cell.";
  if (summary.error) return sentence(summary.error);
  if (live === null) return "Nothing is known of the robot yet.";
  if (live.fault) return "A fault is latched: look at the arm, then acknowledge it above.";
  if (live.not_executable) return sentence(live.not_executable);
  const refusal = live.robot?.refusals?.[0];
  return refusal === undefined ? null : sentence(refusal);
}

/** The service's words as a sentence of the page: a capital, a full stop, and commands in quotation marks. */
export function sentence(text: string): string {
  const quoted = text.replace(/`([^`]*)`/g, "“$1”");
  return `${quoted[0]?.toUpperCase() ?? ""}${quoted.slice(1)}${/[.!?]$/.test(quoted) ? "" : "."}`;
}
