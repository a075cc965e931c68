// The timeline: one cursor for scene and curves, and the curves against their limits.

import { useSignal, useSignalEffect } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useMemo, useRef } from "preact/hooks";

import { type Chart, type ChartColors, createChart } from "../curves/chart";
import { curveDrawing } from "../curves/drawing";
import { bindingCheck, type JointLimits, type Quantity, quantitiesOf } from "../curves/quantities";
import { save } from "../service/save";
import type { CellModel, Plan } from "../service/types";
import { answered, curves, dark, endTime, model, playing, shown, standing, time } from "../state/store";
import { figure } from "../state/words";
import { Icon } from "./icons";

const HEIGHT_PX = 148;

export function TimelineSection(): JSX.Element {
  const plan = shown.value;
  const stale = standing.value === "stale" && plan === answered.value;
  return (
    <section class={`timeline ${stale ? "stale" : ""}`} aria-label="Timeline">
      <Transport />
      {plan === null ? <p class="empty">The motion over time appears here: positions, speeds, torques, each with its limit.</p> : <Curves plan={plan} />}
    </section>
  );
}

function Transport(): JSX.Element {
  const end = endTime.value;
  const off = end === 0;
  const toggle = (pace: number): void => {
    if (playing.value === 0 && time.value >= end - 1e-6) time.value = 0;
    playing.value = playing.value === pace ? 0 : pace;
  };
  const paused = playing.value === 0;
  return (
    <div class="transport">
      <button type="button" class="icon" disabled={off} aria-label={playing.value === 1 ? "Pause" : "Play"} onClick={() => toggle(1)}>
        <Icon name={playing.value === 1 ? "pause" : "play"} />
      </button>
      <button type="button" class="icon slow" disabled={off} aria-pressed={playing.value === SLOW} aria-label="Slow motion" onClick={() => toggle(SLOW)}>
        ⅛×
      </button>
      <input
        type="range" min="0" max={end || 1} step="0.002" disabled={off} aria-label="Time [s]" value={time.value}
        aria-valuetext={`${time.value.toFixed(3)} s${paused ? "" : ", playing"}`}
        onInput={(event) => {
          playing.value = 0;
          time.value = Number(event.currentTarget.value);
        }}
      />
      <output class="clock">{off ? "–" : `${time.value.toFixed(2)} / ${end.toFixed(2)} s`}</output>
    </div>
  );
}

const SLOW = 0.125;

/** Limits for the samples of a preview, which has no curves of the service's. */
function limitsOf(cellModel: CellModel | null, plan: Plan): JointLimits {
  const limits = cellModel?.limits ?? null;
  const asked = (plan.request["limits"] ?? {}) as Record<string, number | number[] | undefined>;
  const each = (value: number | readonly number[] | undefined): readonly number[] | null =>
    value === undefined ? null : typeof value === "number" ? Array.from({ length: 6 }, () => value) : value;
  return {
    lower: each(limits?.position_lower_rad),
    upper: each(limits?.position_upper_rad),
    velocity: each(asked["velocity"] ?? limits?.velocity_rad_s),
    acceleration: each(asked["acceleration"] ?? limits?.acceleration_rad_s2),
    jerk: each(asked["jerk"] ?? limits?.jerk_rad_s3),
  };
}

function Curves({ plan }: { plan: Plan }): JSX.Element {
  const chosen = useSignal<string | null>(null);
  const hidden = useSignal<readonly number[]>([]);
  const own = curves.value !== null && curves.value.planId === plan.id ? curves.value.value : null; // a preview has no id
  const quantities = useMemo(() => quantitiesOf(plan, limitsOf(model.value, plan), own), [plan, own, model.value]);
  const binding = bindingCheck(plan.certificate.checks);
  const first = quantities.find((quantity) => quantity.check === binding?.name) ?? quantities[1];
  const quantity = quantities.find(({ key }) => key === chosen.value) ?? first;
  const chart = useRef<Chart | null>(null);
  const release_s = plan.flight ? plan.release_time_s : null;
  if (!quantity) return <p class="empty">This plan came without its samples.</p>;
  return (
    <div class="curves">
      <div class="quantities" role="group" aria-label="Quantity">
        {quantities.map(({ key, label, check }) => (
          <button
            key={key} type="button" class={`chip ${check === binding?.name ? "binding" : ""}`} aria-pressed={key === quantity.key}
            onClick={() => {
              chosen.value = key;
              hidden.value = [];
            }}
          >
            {label}
            {check === binding?.name ? <span class="sr-only"> (its limit binds)</span> : null}
          </button>
        ))}
      </div>
      <ChartView
        quantity={quantity} hidden={hidden.value} binding={quantity.check === binding?.name} release_s={release_s}
        onChart={(made) => (chart.current = made)}
      />
      <Legend
        quantity={quantity} hidden={hidden.value}
        onSave={(form) => {
          const content = form === "svg" ? Promise.resolve(new Blob([curveDrawing(quantity, release_s)], { type: "image/svg+xml" })) : chart.current?.png();
          void content?.then((blob) => save(blob, `${quantity.key}.${form}`));
        }}
        onToggle={(line) => (hidden.value = hidden.value.includes(line) ? hidden.value.filter((i) => i !== line) : [...hidden.value, line])}
      />
    </div>
  );
}

interface LegendProps {
  readonly quantity: Quantity;
  readonly hidden: readonly number[];
  readonly onToggle: (line: number) => void;
  readonly onSave: (form: "svg" | "png") => void;
}

/** Name and value at the cursor of each line; a click hides it. */
function Legend({ quantity, hidden, onToggle, onSave }: LegendProps): JSX.Element {
  const at = nearestIndex(quantity.times, time.value);
  return (
    <ul class="legend" aria-label={`${quantity.label} [${quantity.unit}]`}>
      <li class="unit">{quantity.unit}</li>
      {quantity.lines.map((line, i) => (
        <li key={line.label}>
          <button type="button" class={`line-${i}`} aria-pressed={!hidden.includes(i)} onClick={() => onToggle(i)}>
            <i aria-hidden="true" />
            {line.label} <span class="value">{figure(line.values[at], 3)}</span>
          </button>
        </li>
      ))}
      <li class="save">
        {(["png", "svg"] as const).map((form) => (
          <button key={form} type="button" class="chip" aria-label={`Save these curves as ${form.toUpperCase()}`} onClick={() => onSave(form)}>
            {form.toUpperCase()}
          </button>
        ))}
      </li>
    </ul>
  );
}

function nearestIndex(times: readonly number[], at: number): number {
  const step = (times[1] ?? 1) - (times[0] ?? 0) || 1;
  return Math.max(0, Math.min(times.length - 1, Math.round((at - (times[0] ?? 0)) / step)));
}

/** The chart's colours, from the style sheet. */
function chartColors(): ChartColors {
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

interface ChartViewProps {
  readonly quantity: Quantity;
  readonly hidden: readonly number[];
  readonly binding: boolean;
  readonly release_s: number | null;
  readonly onChart: (chart: Chart | null) => void;
}

function ChartView({ quantity, hidden, binding, release_s, onChart }: ChartViewProps): JSX.Element {
  const host = useRef<HTMLDivElement>(null);
  const chart = useRef<Chart | null>(null);
  const isDark = dark.value;
  useEffect(() => {
    const element = host.current;
    if (element === null) return;
    const visible = quantity.lines.map((_, i) => !hidden.includes(i));
    const onTime = (at: number): void => {
      playing.value = 0;
      time.value = Math.min(at, endTime.value);
    };
    chart.current = createChart(element, quantity, { height: HEIGHT_PX, colors: chartColors(), release_s, binding, visible, onTime });
    chart.current.setTime(time.peek());
    onChart(chart.current);
    const observer = new ResizeObserver(() => chart.current?.resize(element.clientWidth));
    observer.observe(element);
    return () => {
      observer.disconnect();
      chart.current?.destroy();
      chart.current = null;
      onChart(null);
    };
  }, [quantity, hidden, binding, release_s, isDark]);
  useSignalEffect(() => chart.current?.setTime(time.value));
  return <div class="chart" ref={host} role="img" aria-label={chartWords(quantity)} />;
}

function chartWords(quantity: Quantity): string {
  const peaks = quantity.lines.map((line) => `${line.label} up to ${figure(Math.max(...line.values.map((v) => Math.abs(v ?? 0))))}`);
  return `${quantity.label} in ${quantity.unit} over time: ${peaks.join(", ")}.`;
}
