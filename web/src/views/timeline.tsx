// The timeline: one cursor for scene and curves, and the curves against their limits.

import { signal, useSignalEffect } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useMemo, useRef } from "preact/hooks";

import { type Chart, createChart, EDGES_PX } from "../curves/chart";
import { curveDrawing } from "../curves/drawing";
import { curveTable } from "../curves/table";
import { bindingCheck, type JointLimits, type Quantity, quantitiesOf } from "../curves/quantities";
import { zoom } from "../curves/zoom";
import { type Flag, flagsOf } from "../model/passages";
import { save } from "../service/save";
import type { CellModel, Plan } from "../service/types";
import { play, tick } from "../state/playback";
import { answered, curves, dark, endTime, model, playing, shown, span, standing, time, zoomed } from "../state/store";
import { figure } from "../state/words";
import { chartColors } from "./colours";
import { Icon } from "./icons";

const HEIGHT_PX = 148;
const SLOW = 0.125;
const ZOOM = 2; // of a step
const KEYS = "Space plays; ← and → go by a tick, with Shift by ten";

const chosen = signal<string | null>(null); // quantity; null: the one whose limit binds
const hidden = signal<readonly number[]>([]); // lines of it

export function TimelineSection(): JSX.Element {
  const plan = shown.value;
  const stale = standing.value === "stale" && plan === answered.value;
  const offered = useQuantities(plan);
  return (
    <section class={`timeline ${stale ? "stale" : ""}`} aria-label="Timeline">
      <div class="timeline-head">
        <Transport />
        {offered ? <Quantities {...offered} /> : null}
      </div>
      <TimeSlider />
      {plan === null ? <p class="empty">The motion over time appears here: positions, speeds, torques, each with its limit.</p> : null}
      {plan !== null && offered === null ? <p class="empty">This plan came without its samples.</p> : null}
      {plan !== null && offered !== null ? <Curves plan={plan} {...offered} /> : null}
    </section>
  );
}

function Transport(): JSX.Element {
  const end = endTime.value;
  const off = end === 0;
  return (
    <div class="transport">
      <button type="button" class="icon" disabled={off} aria-label={playing.value === 1 ? "Pause" : "Play"} aria-keyshortcuts="Space" title={KEYS} onClick={() => play(1)}>
        <Icon name={playing.value === 1 ? "pause" : "play"} />
      </button>
      <button type="button" class="icon slow" disabled={off} aria-pressed={playing.value === SLOW} aria-label="Slow motion" onClick={() => play(SLOW)}>
        ⅛×
      </button>
      <output class="clock">{off ? "–" : `${time.value.toFixed(2)} / ${end.toFixed(2)} s`}</output>
      <div class="zoom" role="group" aria-label="Zoom of the time">
        <button type="button" class="chip" disabled={off} aria-label="Show less of the time" onClick={() => zoomAt(1 / ZOOM, time.value)}>
          +
        </button>
        <button type="button" class="chip" disabled={off || zoomed.value === null} aria-label="Show more of the time" onClick={() => zoomAt(ZOOM, time.value)}>
          −
        </button>
      </div>
    </div>
  );
}

function zoomAt(factor: number, at_s: number): void {
  zoomed.value = zoom(span.value, factor, at_s, endTime.value);
}

/** The cursor, over the same time as the curves below it. */
function TimeSlider(): JSX.Element {
  const [from, to] = span.value;
  const off = endTime.value === 0;
  return (
    <div class="time-slider" style={{ paddingLeft: `${EDGES_PX.left - THUMB_PX / 2}px`, paddingRight: `${EDGES_PX.right - THUMB_PX / 2}px` }}>
      <input
        type="range" min={from} max={to} step={tick()} disabled={off} aria-label="Time [s]" value={time.value}
        aria-valuetext={`${time.value.toFixed(3)} s${playing.value === 0 ? "" : ", playing"}`}
        onInput={(event) => {
          playing.value = 0;
          time.value = Number(event.currentTarget.value);
        }}
      />
    </div>
  );
}

const THUMB_PX = 16; // [px] of the slider, as the style sheet has it

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

interface Offered {
  readonly quantities: readonly Quantity[];
  readonly quantity: Quantity; // the one that is shown
  readonly binding: string | null; // name of the check whose limit binds
}

/** What can be drawn of a plan, and what of it is; null for nothing. */
function useQuantities(plan: Plan | null): Offered | null {
  const own = curves.value !== null && curves.value.planId === plan?.id ? curves.value.value : null; // a preview has no id
  const cellModel = model.value;
  const quantities = useMemo(() => (plan === null ? [] : quantitiesOf(plan, limitsOf(cellModel, plan), own)), [plan, own, cellModel]);
  const binding = plan === null ? null : (bindingCheck(plan.certificate.checks)?.name ?? null);
  const first = quantities.find((quantity) => quantity.check === binding) ?? quantities[1];
  const quantity = quantities.find(({ key }) => key === chosen.value) ?? first;
  return quantity === undefined ? null : { quantities, quantity, binding };
}

function Quantities({ quantities, quantity, binding }: Offered): JSX.Element {
  return (
    <div class="quantities" role="group" aria-label="Quantity">
      {quantities.map(({ key, label, check }) => (
        <button
          key={key} type="button" class={`chip ${check === binding ? "binding" : ""}`} aria-pressed={key === quantity.key}
          onClick={() => {
            chosen.value = key;
            hidden.value = [];
          }}
        >
          {label}
          {check === binding ? <span class="sr-only"> (its limit binds)</span> : null}
        </button>
      ))}
    </div>
  );
}

function Curves({ plan, quantity, binding }: Offered & { plan: Plan }): JSX.Element {
  const chart = useRef<Chart | null>(null);
  const flags = useMemo(() => flagsOf(plan), [plan]);
  return (
    <div class="curves">
      <ChartView
        quantity={quantity} hidden={hidden.value} binding={quantity.check === binding} flags={flags}
        onChart={(made) => (chart.current = made)}
      />
      <Legend
        quantity={quantity} hidden={hidden.value}
        onSave={(form) => void curvesAs(form, quantity, flags, chart.current).then((blob) => blob && save(blob, `${quantity.key}.${form}`))}
        onToggle={(line) => (hidden.value = hidden.value.includes(line) ? hidden.value.filter((i) => i !== line) : [...hidden.value, line])}
      />
      {plan.passages ? <Flags flags={flags} /> : null}
    </div>
  );
}

const FORMS = ["png", "svg", "csv"] as const;
type Form = (typeof FORMS)[number];

/** Returns the curves as a picture, as a drawing or as numbers. */
async function curvesAs(form: Form, quantity: Quantity, flags: readonly Flag[], chart: Chart | null): Promise<Blob | undefined> {
  if (form === "png") return chart?.png();
  if (form === "svg") return new Blob([curveDrawing(quantity, flags)], { type: "image/svg+xml" });
  return new Blob([curveTable(quantity)], { type: "text/csv" });
}

/** What happens at an instant; a click goes there. */
function Flags({ flags }: { readonly flags: readonly Flag[] }): JSX.Element {
  const go = (at_s: number): void => {
    playing.value = 0;
    time.value = Math.min(Math.max(at_s, 0), endTime.value);
  };
  return (
    <ol class="flags" aria-label="Passages and outputs">
      {flags.map(({ at_s, text, level }) => (
        <li key={`${text} ${at_s}`}>
          <button type="button" class={`chip ${level === null ? "passage" : ""}`} onClick={() => go(at_s)}>
            {text} <span class="value">{at_s.toFixed(3)} s</span>
          </button>
        </li>
      ))}
    </ol>
  );
}

interface LegendProps {
  readonly quantity: Quantity;
  readonly hidden: readonly number[];
  readonly onToggle: (line: number) => void;
  readonly onSave: (form: Form) => void;
}

/** Name and value at the cursor of each line; a click hides it. */
function Legend({ quantity, hidden, onToggle, onSave }: LegendProps): JSX.Element {
  const at = nearestIndex(quantity.times, time.value);
  return (
    <ul class="legend" aria-label={`${quantity.label} [${quantity.unit}]`}>
      {quantity.lines.map((line, i) => (
        <li key={line.label}>
          <button type="button" class={`line-${i}`} aria-pressed={!hidden.includes(i)} onClick={() => onToggle(i)}>
            <i aria-hidden="true" />
            {line.label} <span class="value">{figure(line.values[at], 3)}</span>
          </button>
        </li>
      ))}
      <li class="save">
        {FORMS.map((form) => (
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

interface ChartViewProps {
  readonly quantity: Quantity;
  readonly hidden: readonly number[];
  readonly binding: boolean;
  readonly flags: readonly Flag[];
  readonly onChart: (chart: Chart | null) => void;
}

function ChartView({ quantity, hidden, binding, flags, onChart }: ChartViewProps): JSX.Element {
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
    const range = span.peek();
    chart.current = createChart(element, quantity, { height: HEIGHT_PX, colors: chartColors(), flags, binding, visible, range, onTime, onZoom: zoomAt });
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
  }, [quantity, hidden, binding, flags, isDark]);
  useSignalEffect(() => chart.current?.setTime(time.value));
  useSignalEffect(() => chart.current?.setRange(span.value));
  return <div class="chart" ref={host} role="img" aria-label={chartWords(quantity)} />;
}

function chartWords(quantity: Quantity): string {
  const peaks = quantity.lines.map((line) => `${line.label} up to ${figure(Math.max(...line.values.map((v) => Math.abs(v ?? 0))))}`);
  return `${quantity.label} in ${quantity.unit} over time: ${peaks.join(", ")}.`;
}
