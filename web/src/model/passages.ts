/** What a plan passes: its release, or its passages, and the edges of their outputs on the time line. */

import type { Plan } from "../service/types";

export interface Flag {
  readonly at_s: number;
  readonly text: string;
  readonly level: boolean | null; // that an output changes to; null for a state that is passed
}

type Passed = NonNullable<Plan["passages"]>[number];

/** The release; of passages that let nothing go, the last one. */
export function mainState(plan: Plan): NonNullable<Plan["release"]> | Passed {
  const state = plan.release ?? plan.passages?.at(-1);
  if (!state) throw new Error("the plan passes nothing");
  return state;
}

/** The time of `mainState` [s]. */
export function mainTime(plan: { readonly release_time_s: number | null; readonly passages?: readonly { readonly time_s: number }[] | null }): number {
  return plan.release_time_s ?? plan.passages?.at(-1)?.time_s ?? 0;
}

/** The sample at which a state is passed, or a line ends. */
export function endIndex(state: { readonly index: number; readonly end_index?: number }): number {
  return state.end_index ?? state.index;
}

/** Returns what happens at an instant of a plan, in the order of the times. */
export function flagsOf(plan: Plan): Flag[] {
  if (!plan.passages) return plan.flight ? [{ at_s: mainTime(plan), text: "release", level: null }] : [];
  const flags = plan.passages.flatMap((passage) => [
    { at_s: passage.time_s, text: passage.name, level: null },
    ...(passage.end_index > passage.index ? [{ at_s: passage.end_index / plan.sample_rate_hz, text: `${passage.name} ends`, level: null }] : []),
    ...passage.outputs.map((edge) => ({ at_s: edge.edge_time_s, text: edgeWords(edge), level: edge.level })),
  ]);
  return flags.sort((a, b) => a.at_s - b.at_s);
}

/** An output's edge in words. */
export function edgeWords({ output, index, level }: Pick<Passed["outputs"][number], "output" | "index" | "level">): string {
  return `${output.replaceAll("_", " ")} ${index} ${level ? "on" : "off"}`;
}
