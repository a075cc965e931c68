/** A curve against its limits as a vector drawing for a paper. */

import type { Flag } from "../model/passages";
import type { Quantity } from "./quantities";

const [WIDTH, HEIGHT] = [640, 320]; // [px]
const EDGE = { left: 64, right: 112, top: 22, bottom: 44 }; // [px]
const TICKS = 6; // about as many on each axis
const COLOURS = ["#0b6bcb", "#d9720b", "#14804a", "#cf2a3c", "#7a3fbf", "#0b8a9b", "#5b6670", "#a16207"];
const LIMIT = "#cf2a3c";
const ROOM = 0.06; // of the range, above and below

interface Range {
  readonly low: number;
  readonly high: number;
}

/** Returns a drawing of a quantity over time, with flags of what happens at an instant. */
export function curveDrawing(quantity: Quantity, flags: readonly Flag[]): string {
  const [t, y] = [rangeOf(quantity.times, 0), rangeOf(valuesOf(quantity), ROOM)];
  const xAt = scale(t, EDGE.left, WIDTH - EDGE.right);
  const yAt = scale(y, HEIGHT - EDGE.bottom, EDGE.top);
  const parts = [
    ...axes(quantity, t, y, xAt, yAt),
    ...limitLines(quantity, y, yAt),
    ...flags.map((flag) => (flag.level === null ? passageLine : pennant)(xAt(flag.at_s), flag)),
    ...quantity.lines.map((line, i) => `<path d="${pathOf(quantity, line.values, xAt, yAt)}" fill="none" stroke="${colourOf(i)}" stroke-width="1.8"/>`),
    ...quantity.lines.map((line, i) => `<text x="${WIDTH - EDGE.right + 10}" y="${EDGE.top + 12 + 17 * i}" fill="${colourOf(i)}">${escaped(line.label)}</text>`),
  ];
  const head = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${WIDTH} ${HEIGHT}" width="${WIDTH}" height="${HEIGHT}" role="img">`;
  return `${head}<title>${escaped(quantity.label)} over time</title><g font-family="sans-serif" font-size="12" fill="#1c2733">${parts.join("\n")}</g></svg>\n`;
}

/** Returns round numbers within a range, about as many as asked for. */
function roundTicks({ low, high }: Range, count = TICKS): number[] {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, i) => Number(((first + i) * step).toPrecision(10)));
}

function valuesOf({ lines, limits }: Quantity): number[] {
  const values = lines.flatMap((line) => line.values).filter((value): value is number => value !== null && Number.isFinite(value));
  const { low, high } = rangeOf(values, 0);
  const near = limits.map(({ value }) => value).filter((value) => value > low - (high - low) && value < high + (high - low));
  return [...values, ...near];
}

function rangeOf(values: readonly number[], room: number): Range {
  const [low, high] = values.reduce(([a, b], value) => [Math.min(a, value), Math.max(b, value)], [Infinity, -Infinity]);
  if (!(high > low)) return { low: (Number.isFinite(low) ? low : 0) - 0.5, high: (Number.isFinite(high) ? high : 0) + 0.5 };
  return { low: low - room * (high - low), high: high + room * (high - low) };
}

function scale({ low, high }: Range, from: number, to: number): (value: number) => number {
  return (value) => from + ((to - from) * (value - low)) / (high - low);
}

function axes(quantity: Quantity, t: Range, y: Range, xAt: (t: number) => number, yAt: (y: number) => number): string[] {
  const bottom = HEIGHT - EDGE.bottom;
  const grid = roundTicks(y).flatMap((value) => [
    `<path d="M${EDGE.left} ${yAt(value).toFixed(1)}H${WIDTH - EDGE.right}" stroke="#dfe4e8"/>`,
    `<text x="${EDGE.left - 8}" y="${(yAt(value) + 4).toFixed(1)}" text-anchor="end">${value}</text>`,
  ]);
  const below = roundTicks(t).flatMap((value) => [
    `<path d="M${xAt(value).toFixed(1)} ${bottom}v4" stroke="#5b6670"/>`,
    `<text x="${xAt(value).toFixed(1)}" y="${bottom + 18}" text-anchor="middle">${value}</text>`,
  ]);
  const middle = (EDGE.top + bottom) / 2;
  return [
    ...grid,
    ...below,
    `<path d="M${EDGE.left} ${EDGE.top}V${bottom}H${WIDTH - EDGE.right}" fill="none" stroke="#5b6670"/>`,
    `<text x="${(EDGE.left + WIDTH - EDGE.right) / 2}" y="${HEIGHT - 8}" text-anchor="middle">time [s]</text>`,
    `<text transform="translate(14 ${middle}) rotate(-90)" text-anchor="middle">${escaped(`${quantity.label} [${quantity.unit}]`)}</text>`,
  ];
}

function limitLines({ limits }: Quantity, y: Range, yAt: (y: number) => number): string[] {
  const shown = limits.filter(({ value }) => value >= y.low && value <= y.high);
  return shown.map(({ value, line }) => {
    const colour = line === null ? LIMIT : colourOf(line);
    return `<path d="M${EDGE.left} ${yAt(value).toFixed(1)}H${WIDTH - EDGE.right}" stroke="${colour}" stroke-dasharray="7 4"/>`;
  });
}

function passageLine(x: number, { text }: Flag): string {
  const at = x.toFixed(1);
  return `<path d="M${at} ${EDGE.top}V${HEIGHT - EDGE.bottom}" stroke="#1c2733" stroke-opacity="0.6" stroke-dasharray="2 3"/><text x="${at}" y="${EDGE.top - 7}" text-anchor="middle">${escaped(text)}</text>`;
}

/** An output's edge: full where it is switched on, empty where it is switched off. */
function pennant(x: number, { text, level }: Flag): string {
  const shape = `<path d="M${x.toFixed(1)} ${EDGE.top + 14}V${EDGE.top}l7 3.5l-7 3.5" stroke="#1c2733" fill="${level ? "#1c2733" : "#fff"}">`;
  return `${shape}<title>${escaped(text)}</title></path>`;
}

/** Returns the path of a line, with gaps where it has no value, and steps where a value holds until the next. */
function pathOf({ times, steps }: Quantity, values: readonly (number | null)[], xAt: (t: number) => number, yAt: (y: number) => number): string {
  let drawn = false;
  return times
    .map((t, i) => {
      const value = values[i] ?? null;
      if (value === null || !Number.isFinite(value)) {
        drawn = false;
        return "";
      }
      const [x, y] = [xAt(t).toFixed(1), yAt(value).toFixed(1)];
      const next = drawn ? (steps ? `H${x}V${y}` : `L${x} ${y}`) : `M${x} ${y}`;
      drawn = true;
      return next;
    })
    .join("");
}

function colourOf(i: number): string {
  return COLOURS[i % COLOURS.length]!;
}

function escaped(text: string): string {
  return text.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
}
