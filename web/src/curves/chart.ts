// One chart over a plan's time: uPlot with limits, a marker of the release and the cursor that the scene shares.

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";

import type { Quantity } from "./quantities";

export interface ChartColors {
  readonly lines: readonly string[];
  readonly ink: string;
  readonly grid: string;
  readonly limit: string;
  readonly paper: string;
}

export interface ChartOptions {
  readonly height: number; // [px]
  readonly colors: ChartColors;
  readonly release_s: number | null; // a mark on the time axis
  readonly binding: boolean; // whether its limit is the one that binds
  readonly visible: readonly boolean[];
  onTime(time_s: number): void;
}

export interface Chart {
  setTime(time_s: number): void;
  resize(width: number): void;
  readonly plot: uPlot;
  destroy(): void;
}

const FONT = "12px system-ui, sans-serif";
const EDGE_S = 0.004; // [s] a cursor this far beyond the curve still stands at its end
const ROOM = 0.08; // of the range, above and below

/** Range of a quantity: its values and those limits that lie within reach of them. */
export function valueRange(quantity: Quantity, visible: readonly boolean[]): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  quantity.lines.forEach((line, i) => {
    if (!visible[i]) return;
    for (const value of line.values) {
      if (value === null || !Number.isFinite(value)) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  });
  if (low > high) return [0, 1];
  const span = Math.max(high - low, 1e-6 * Math.max(1, Math.abs(high)));
  for (const { value, line } of quantity.limits) {
    if (line !== null && !visible[line]) continue;
    if (value > high && value < high + span) high = value;
    if (value < low && value > low - span) low = value;
  }
  const room = ROOM * (high - low || 1);
  return [low - room, high + room];
}

function drawLimits(plot: uPlot, quantity: Quantity, options: ChartOptions): void {
  const { ctx, bbox } = plot;
  const scale = devicePixelRatio;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  for (const { value, line } of quantity.limits) {
    if (line !== null && !options.visible[line]) continue;
    const y = Math.round(plot.valToPos(value, "y", true));
    ctx.strokeStyle = line === null ? options.colors.limit : (options.colors.lines[line] ?? options.colors.limit);
    ctx.globalAlpha = line === null ? 1 : 0.6;
    ctx.lineWidth = (options.binding ? 2 : 1) * scale;
    ctx.setLineDash([6 * scale, 4 * scale]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  }
  if (options.release_s !== null) drawRelease(plot, options, options.release_s, scale);
  ctx.restore();
}

function drawRelease(plot: uPlot, options: ChartOptions, release_s: number, scale: number): void {
  const { ctx, bbox } = plot;
  const x = Math.round(plot.valToPos(release_s, "x", true));
  ctx.globalAlpha = 0.7;
  ctx.strokeStyle = options.colors.ink;
  ctx.lineWidth = scale;
  ctx.setLineDash([2 * scale, 3 * scale]);
  ctx.beginPath();
  ctx.moveTo(x, bbox.top);
  ctx.lineTo(x, bbox.top + bbox.height);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.fillStyle = options.colors.ink;
  ctx.font = `${11 * scale}px system-ui, sans-serif`;
  ctx.globalAlpha = 1;
  const width = ctx.measureText("release").width;
  const right = x + 5 * scale + width < bbox.left + bbox.width;
  const at = [right ? x + 5 * scale : x - 5 * scale - width, bbox.top + bbox.height - 5 * scale] as const;
  ctx.textAlign = "left";
  ctx.strokeStyle = options.colors.paper;
  ctx.lineWidth = 4 * scale;
  ctx.strokeText("release", ...at); // a halo, where it lies on a line
  ctx.fillText("release", ...at);
}

/** Draws one quantity into `host`. A click or a drag in it moves the time. */
export function createChart(host: HTMLElement, quantity: Quantity, options: ChartOptions): Chart {
  const { colors } = options;
  const axis = { stroke: colors.ink, font: FONT, grid: { stroke: colors.grid, width: 1 }, ticks: { stroke: colors.grid, width: 1 } };
  const stepped = uPlot.paths.stepped?.({ align: 1 });
  const plot = new uPlot(
    {
      width: Math.max(120, host.clientWidth),
      height: options.height,
      legend: { show: false },
      cursor: { x: true, y: false, drag: { x: false, y: false }, points: { size: 6 } },
      scales: { x: { time: false }, y: { range: () => valueRange(quantity, options.visible) } },
      axes: [
        { ...axis, size: 28, space: 72, values: (_, ticks) => ticks.map((tick) => `${Number(tick.toFixed(3))} s`) },
        { ...axis, size: 52, space: 26 },
      ],
      series: [
        {},
        ...quantity.lines.map((line, i) => ({
          label: line.label,
          stroke: colors.lines[i % colors.lines.length] ?? colors.ink,
          width: 1.75,
          show: options.visible[i] ?? true,
          points: { show: false },
          ...(quantity.steps && stepped ? { paths: stepped } : {}),
        })),
      ],
      hooks: { draw: [(drawn) => drawLimits(drawn, quantity, options)] },
    },
    [quantity.times as number[], ...quantity.lines.map((line) => line.values as (number | null)[])],
    host,
  );
  const mark = document.createElement("div");
  mark.className = "chart-cursor";
  plot.over.append(mark);
  const pointed = (event: PointerEvent): void => {
    if (event.type === "pointermove" && event.buttons === 0) return;
    const box = plot.over.getBoundingClientRect();
    options.onTime(Math.max(0, plot.posToVal(event.clientX - box.left, "x")));
  };
  plot.over.addEventListener("pointerdown", pointed);
  plot.over.addEventListener("pointermove", pointed);
  return {
    plot,
    setTime(time_s) {
      const [first, last] = [quantity.times[0] ?? 0, quantity.times.at(-1) ?? 0];
      mark.hidden = time_s < first - EDGE_S || time_s > last + EDGE_S;
      const x = plot.valToPos(time_s, "x");
      mark.style.transform = `translateX(${x}px)`;
    },
    resize(width) {
      plot.setSize({ width: Math.max(120, width), height: options.height });
    },
    destroy() {
      plot.destroy();
    },
  };
}
