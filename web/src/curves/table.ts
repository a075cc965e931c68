/** A quantity over time as a table of comma-separated values. Pure. */

import type { Quantity } from "./quantities";

/** Returns a line of names with their unit, then one for each sample; what is not known is empty. */
export function curveTable({ times, lines, unit }: Quantity): string {
  const head = ["time [s]", ...lines.map(({ label }) => `${label} [${unit}]`)];
  const rows = times.map((t, i) => [t, ...lines.map(({ values }) => values[i] ?? "")]);
  return [head, ...rows].map((row) => `${row.join(",")}\n`).join("");
}
