// Recordings of executions, as far as two of them are compared. Pure.

/** How far an arm was from its plan, over the plan's time. */
export interface Deviation {
  readonly times: readonly number[]; // [s]
  readonly largest: readonly number[]; // of the six joints [rad]
}

const JOINTS = 6;

/** Reads a recording (CSV of `/executions/{id}/recording`): the largest deviation of a joint at each tick. */
export function deviationOf(csv: string): Deviation {
  const [head = "", ...rows] = csv.trim().split("\n");
  const names = head.trim().split(",");
  const clock = names.indexOf("clock_s");
  const [measured, planned] = ["q", "planned_q"].map((name) => Array.from({ length: JOINTS }, (_, j) => names.indexOf(`${name}_${j}_rad`)));
  const times: number[] = [];
  const largest: number[] = [];
  for (const row of rows) {
    const values = row.split(",").map(Number);
    const apart = measured!.map((column, j) => Math.abs((values[column] ?? NaN) - (values[planned![j]!] ?? NaN)));
    times.push(values[clock] ?? NaN);
    largest.push(Math.max(...apart));
  }
  return { times, largest };
}

/** Returns two deviations over common times, null where one of them has no value. */
export function together(a: Deviation, b: Deviation, step_s: number): { times: number[]; values: (number | null)[][] } {
  const tick = (t: number): number => Math.round(t / step_s);
  const ticks = [...new Set([...a.times, ...b.times].map(tick))].sort((x, y) => x - y);
  const values = [a, b].map((each) => {
    const at = new Map(each.times.map((t, i) => [tick(t), each.largest[i]!]));
    return ticks.map((t) => at.get(t) ?? null);
  });
  return { times: ticks.map((t) => t * step_s), values };
}
