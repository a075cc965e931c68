// One chart over a plan's time: uPlot with limits, flags of what happens at an instant, and the cursor that the scene shares.

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import "../style/chart.css";

import type { Flag } from "../model/passages";
import { pngOf } from "../service/save";
import { figure } from "../state/words";
import type { Quantity } from "./quantities";
import { axisRange, TICK_STEPS, tickTexts } from "./ticks";

export interface ChartColors {
  readonly lines: readonly string[];
  readonly ink: string;
  readonly grid: string;
  readonly limit: string;
  readonly paper: string;
}

interface ChartOptions {
  readonly height: number; // [px]
  readonly colors: ChartColors;
  readonly flags: readonly Flag[]; // on the time axis
  readonly binding: boolean; // whether its limit is the one that binds
  readonly visible: readonly boolean[];
  readonly range: readonly [number, number]; // of the time axis [s]
  onTime(time_s: number): void;
  /** A pinch, or the wheel with Ctrl: `factor` above 1 shows more of the time. */
  onZoom?(factor: number, at_s: number): void;
}

export interface Chart {
  setTime(time_s: number): void;
  setRange(range: readonly [number, number]): void;
  resize(width: number): void;
  /** Resolves with the curves as they are on the screen, with their names. */
  png(): Promise<Blob>;
  destroy(): void;
}

const FONT = "12px system-ui, sans-serif";
const EDGE_S = 0.004; // [s] a cursor this far beyond the axis still stands at its end
const WHEEL = 0.002; // zoom for each unit that a wheel turns
const LEAST_PX = 120; // [px] width
/** Space beside the curves [px]: a control over the same time lies between them. */
export const EDGES_PX = { left: 76, right: 24 } as const;
const LABEL_PX = 16; // [px] of the axis's unit
const PENNANT_PX = [7, 7] as const; // [px] width and height

/** Range of a quantity: the lines that are shown, and their limits. */
function valueRange({ lines, limits }: Quantity, visible: readonly boolean[]): [number, number] {
  const values = lines.flatMap((line, i) => (visible[i] ? line.values : []));
  return axisRange(values, limits.filter(({ line }) => line === null || visible[line]).map(({ value }) => value));
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
  for (const flag of options.flags) (flag.level === null ? drawPassage : drawEdge)(plot, options, flag, scale);
  ctx.restore();
}

function drawPassage(plot: uPlot, options: ChartOptions, { at_s, text }: Flag, scale: number): void {
  const { ctx, bbox } = plot;
  const x = Math.round(plot.valToPos(at_s, "x", true));
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
  const width = ctx.measureText(text).width;
  const right = x + 5 * scale + width < bbox.left + bbox.width;
  const at = [right ? x + 5 * scale : x - 5 * scale - width, bbox.top + bbox.height - 5 * scale] as const;
  ctx.textAlign = "left";
  ctx.strokeStyle = options.colors.paper;
  ctx.lineWidth = 4 * scale;
  ctx.strokeText(text, ...at); // a halo, where it lies on a line
  ctx.fillText(text, ...at);
}

/** An output's edge is a pennant at the top: full where it is switched on, empty where it is switched off. */
function drawEdge(plot: uPlot, options: ChartOptions, { at_s, level }: Flag, scale: number): void {
  const { ctx, bbox } = plot;
  const x = Math.round(plot.valToPos(at_s, "x", true));
  ctx.globalAlpha = 1;
  ctx.setLineDash([]);
  ctx.lineWidth = scale;
  ctx.strokeStyle = options.colors.ink;
  ctx.fillStyle = level ? options.colors.ink : options.colors.paper;
  ctx.beginPath();
  ctx.moveTo(x, bbox.top + PENNANT_PX[1] * 2 * scale);
  ctx.lineTo(x, bbox.top);
  ctx.lineTo(x + PENNANT_PX[0] * scale, bbox.top + (PENNANT_PX[1] / 2) * scale);
  ctx.lineTo(x, bbox.top + PENNANT_PX[1] * scale);
  ctx.fill();
  ctx.stroke();
}

const HEAD_PX = 26; // [px] for the names above the curves

/** Returns the plot as PNG, under the names of its lines. */
async function pictureOf(plot: uPlot, quantity: Quantity, { colors, visible }: ChartOptions): Promise<Blob> {
  const [drawn, scale] = [plot.ctx.canvas, devicePixelRatio];
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: drawn.width, height: drawn.height + HEAD_PX * scale });
  const ctx = canvas.getContext("2d");
  if (ctx === null) throw new Error("the picture could not be drawn");
  ctx.fillStyle = colors.paper;
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.drawImage(drawn, 0, HEAD_PX * scale);
  ctx.font = `${12 * scale}px system-ui, sans-serif`;
  let x = 12 * scale;
  const write = (text: string, colour: string): void => {
    ctx.fillStyle = colour;
    ctx.fillText(text, x, 17 * scale);
    x += ctx.measureText(text).width + 14 * scale;
  };
  write(`${quantity.label} [${quantity.unit}]`, colors.ink);
  quantity.lines.forEach(({ label }, i) => visible[i] && write(label, colors.lines[i % colors.lines.length] ?? colors.ink));
  return pngOf(canvas);
}

/** Tells the time under the pointer and the value of each line there, beside the pointer. */
function readOut(plot: uPlot, quantity: Quantity, { colors, visible }: ChartOptions, readout: HTMLElement): void {
  const { left = -1, idx } = plot.cursor;
  readout.hidden = left < 0 || plot.posToVal(left, "x") > (quantity.times.at(-1) ?? 0);
  if (readout.hidden || idx === null || idx === undefined) return;
  const lines = quantity.lines.flatMap((line, i) => {
    const value = line.values[idx];
    if (!visible[i] || value === null || value === undefined) return [];
    return [written(`${line.label} ${figure(value, 4)}`, colors.lines[i % colors.lines.length] ?? colors.ink)];
  });
  readout.replaceChildren(written(`${quantity.times[idx]!.toFixed(3)} s, ${quantity.unit}`, colors.ink), ...lines);
  const isRight = left > plot.over.clientWidth / 2;
  readout.style.transform = `translateX(calc(${left}px ${isRight ? "- 100% - 10px" : "+ 10px"}))`;
}

function written(text: string, colour: string): HTMLElement {
  const row = document.createElement("div");
  row.textContent = text;
  row.style.color = colour;
  return row;
}

/** Draws one quantity into `host`. A click or a drag in it moves the time. */
export function createChart(host: HTMLElement, quantity: Quantity, options: ChartOptions): Chart {
  const { colors } = options;
  const axis = { stroke: colors.ink, font: FONT, incrs: TICK_STEPS, grid: { stroke: colors.grid, width: 1 }, ticks: { stroke: colors.grid, width: 1 } };
  const mark = document.createElement("div");
  mark.className = "chart-cursor";
  mark.hidden = true;
  const readout = document.createElement("div");
  readout.className = "chart-readout";
  readout.hidden = true;
  let shown: number | null = null; // [s]; null: this chart has no cursor
  let range = options.range;
  const place = (drawn: uPlot): void => {
    if (shown === null) return;
    mark.hidden = shown < range[0] - EDGE_S || shown > range[1] + EDGE_S;
    mark.style.transform = `translateX(${drawn.valToPos(shown, "x")}px)`;
  };
  const stepped = uPlot.paths.stepped?.({ align: 1 });
  const plot = new uPlot(
    {
      width: Math.max(LEAST_PX, host.clientWidth),
      height: options.height,
      legend: { show: false },
      cursor: { x: true, y: false, drag: { x: false, y: false }, points: { size: 6 } },
      padding: [8, EDGES_PX.right, 0, 0],
      scales: { x: { time: false, range: () => [...range] }, y: { range: () => valueRange(quantity, options.visible) } },
      axes: [
        { ...axis, size: 28, space: 72, values: (_, ticks) => tickTexts(ticks).map((text) => `${text} s`) },
        {
          ...axis, size: EDGES_PX.left - LABEL_PX, space: 26, values: (_, ticks) => tickTexts(ticks),
          label: quantity.unit, labelSize: LABEL_PX, labelGap: 0, labelFont: FONT,
        },
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
      hooks: {
        draw: [
          (drawn) => {
            drawLimits(drawn, quantity, options);
            place(drawn); // its scales may be others
          },
        ],
        setCursor: [(drawn) => readOut(drawn, quantity, options, readout)],
      },
    },
    [quantity.times as number[], ...quantity.lines.map((line) => line.values as (number | null)[])],
    host,
  );
  plot.over.append(mark, readout);
  const pointed = (event: PointerEvent): void => {
    if (event.type === "pointermove" && event.buttons === 0) return;
    const box = plot.over.getBoundingClientRect();
    options.onTime(Math.max(0, plot.posToVal(event.clientX - box.left, "x")));
  };
  plot.over.addEventListener("pointerdown", pointed);
  plot.over.addEventListener("pointermove", pointed);
  const wheeled = (event: WheelEvent): void => {
    if (!event.ctrlKey || !options.onZoom) return; // without Ctrl the wheel moves the page
    event.preventDefault();
    options.onZoom(Math.exp(WHEEL * event.deltaY), plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
  };
  plot.over.addEventListener("wheel", wheeled, { passive: false });
  return {
    setTime(time_s) {
      shown = time_s;
      place(plot);
    },
    setRange(wanted) {
      if (wanted[0] === range[0] && wanted[1] === range[1]) return;
      range = wanted;
      plot.setScale("x", { min: wanted[0], max: wanted[1] });
    },
    resize(width) {
      const wanted = Math.max(LEAST_PX, width);
      if (wanted !== plot.width) plot.setSize({ width: wanted, height: options.height });
    },
    png: () => pictureOf(plot, quantity, options),
    destroy() {
      plot.destroy();
    },
  };
}
