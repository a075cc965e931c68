// Colours of the style sheet, for what is drawn on a canvas.

import type { ChartColors } from "../curves/chart";

export function chartColors(): ChartColors {
  const style = getComputedStyle(document.documentElement);
  const color = (name: string): string => style.getPropertyValue(name).trim();
  return {
    lines: [0, 1, 2, 3, 4, 5].map((i) => color(`--line-${i}`)),
    ink: color("--soft"),
    grid: color("--hair"),
    limit: color("--bad"),
    paper: color("--paper"),
  };
}
