// Two executions beside each other: what came of them, in numbers, and how far each was from its plan over time.

import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";

import { createChart } from "../curves/chart";
import type { Quantity } from "../curves/quantities";
import { mainTime } from "../model/passages";
import { call, get } from "../service/client";
import type { Execution, Plan } from "../service/types";
import { aimOf, placeWords } from "../state/machine";
import { type Deviation, deviationOf, together } from "../state/recordings";
import { compared, dark, failed, floorZ, landings } from "../state/store";
import { offsetFrom } from "../state/scatter";
import { dateWords, figure, length, metricRows, outcomeWords } from "../state/words";
import { chartColors } from "./colours";

interface Side {
  readonly run: Execution;
  readonly plan: Plan;
  readonly deviation: Deviation | null; // null: it has no recording
}

const HEIGHT_PX = 180;

export function Comparison(): JSX.Element | null {
  const ids = compared.value;
  const sides = useSignal<readonly Side[] | null>(null);
  const reason = useSignal<string | null>(null);
  useEffect(() => {
    sides.value = reason.value = null;
    if (ids.length < 2) return;
    let over = false;
    Promise.all(ids.map(loadSide)).then(
      (loaded) => !over && (sides.value = loaded),
      (error) => !over && (reason.value = failed(error)),
    );
    return () => {
      over = true;
    };
  }, [ids]);
  if (ids.length === 0) return null;
  return (
    <section class="comparison" aria-label="Comparison">
      <div class="who">
        <h3>Comparison</h3>
        <button type="button" class="quiet small" onClick={() => (compared.value = [])}>
          Close the comparison
        </button>
      </div>
      {ids.length === 1 ? <p class="soft">Choose a second one.</p> : null}
      {ids.length === 2 && sides.value === null ? <p class={reason.value ? "bad" : "soft"}>{reason.value ?? "Loading …"}</p> : null}
      {sides.value ? <Beside sides={sides.value} /> : null}
    </section>
  );
}

async function loadSide(id: string): Promise<Side> {
  const run = await get<Execution>(`/executions/${id}`);
  const plan = await get<Plan>(`/plans/${run.plan_id}?trajectory=false`);
  let deviation: Deviation | null = null;
  try {
    deviation = deviationOf(await (await call("GET", `/executions/${id}/recording`, { accept: "text/csv", patient: true })).text());
  } catch {
    // nothing was recorded: the numbers are compared all the same
  }
  return { run, plan, deviation };
}

function Beside({ sides }: { sides: readonly Side[] }): JSX.Element {
  const facts = sides.map(factsOf);
  const names = [...new Set(facts.flatMap((rows) => rows.map(([name]) => name)))];
  return (
    <>
      <div class="scroll" tabIndex={0} role="group" aria-label="Numbers of both">
        <table>
          <thead>
            <tr>
              <th scope="col"><span class="sr-only">Quantity</span></th>
              {sides.map(({ run }, i) => <th key={run.id} scope="col" class={`line-${i}`}>{dateWords(run.created_at)}</th>)}
            </tr>
          </thead>
          <tbody>
            {names.map((name) => (
              <tr key={name}>
                <th scope="row">{name}</th>
                {facts.map((rows, i) => <td key={i}>{rows.find(([own]) => own === name)?.[1] ?? "–"}</td>)}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      <DeviationChart sides={sides} />
    </>
  );
}

function factsOf({ run, plan }: Side): readonly (readonly [string, string])[] {
  const aim = aimOf(plan);
  const offset = offsetFrom(aim, landings.value[run.id] ?? []);
  return [
    ["Outcome", outcomeWords({ ...run, dryRun: run.dry_run })],
    ["Target", aim ? placeWords(aim, floorZ.value) : "–"],
    [plan.release ? "Release" : "Last passage", `${figure(mainTime(plan))} s${plan.flight ? ` at ${figure(plan.flight.speed_m_s)} m/s` : ""}`],
    ["Streamed by", run.mode],
    ...(offset ? ([["Reported off in x, y", offset.map((x) => length(x)).join(", ")]] as const) : []),
    ...metricRows(run.metrics ?? {}),
  ];
}

function DeviationChart({ sides }: { sides: readonly Side[] }): JSX.Element | null {
  const host = useRef<HTMLDivElement>(null);
  const isDark = dark.value;
  const recorded = sides.every((side) => side.deviation !== null);
  useEffect(() => {
    const element = host.current;
    if (element === null || !recorded) return;
    const quantity = quantityOf(sides);
    const ends = [quantity.times[0] ?? 0, quantity.times.at(-1) ?? 1] as const;
    const options = { height: HEIGHT_PX, colors: chartColors(), flags: [], binding: false, visible: [true, true], range: ends };
    const chart = createChart(element, quantity, { ...options, onTime: () => undefined });
    const observer = new ResizeObserver(() => chart.resize(element.clientWidth));
    observer.observe(element);
    return () => {
      observer.disconnect();
      chart.destroy();
    };
  }, [sides, isDark, recorded]);
  if (!recorded) return <p class="soft">Not both have a recording: no curves.</p>;
  return (
    <figure>
      <figcaption class="hint">Largest deviation of a joint from its plan, over the plan's time</figcaption>
      <div class="chart" ref={host} role="img" aria-label="Largest deviation of a joint from its plan, of both executions" />
    </figure>
  );
}

function quantityOf(sides: readonly Side[]): Quantity {
  const [first, second] = sides as readonly [Side, Side];
  const { times, values } = together(first.deviation!, second.deviation!, 1 / first.plan.sample_rate_hz);
  const lines = sides.map(({ run }, i) => ({ label: dateWords(run.created_at), values: values[i]!.map((x) => x && 1000 * x) }));
  return { key: "deviation", label: "Deviation", unit: "mrad", check: null, times, steps: false, lines, limits: [] };
}
