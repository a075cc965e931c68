// The execution of the chosen cell, whoever started it: preflight, phases, tracking, and in the end the outcome.

import type { JSX } from "preact";

import type { Plan } from "../service/types";
import { leavePast } from "../state/actions";
import { takeRequest } from "../state/follow";
import { hashOf } from "../state/links";
import { aimOf, PHASES, placeWords, type Run, type Sample, wentThrough } from "../state/machine";
import { sentence } from "../state/readiness";
import { offsetFrom } from "../state/scatter";
import { JOINTS } from "../curves/quantities";
import { answered, cellName, cellState, execution, floorZ, landings, runPlan, viewing } from "../state/store";
import {
  adviceAfter, dateWords, figure, keyNumbers, metricRows, outcomeTone, outcomeWords, PHASE_WORDS, plainWords, preflight,
} from "../state/words";
import { Icon } from "./icons";
import { toBeReported } from "../state/calibrate";
import { LandingReports } from "./landing";

export function ExecutionSection(): JSX.Element {
  const [run, cell] = [execution.value, cellName.value];
  return (
    <section class="card execution" aria-labelledby="execution-title">
      <h2 id="execution-title">Execution</h2>
      {cell !== null && (run === null || (run.state !== "finished" && !PAST_PREFLIGHT.has(run.state))) ? <Preflight /> : null}
      {run === null ? <p class="soft">{cell === null ? "Which cell this is about is not known yet." : `Nothing is running on ${cell}.`}</p> : <RunView run={run} />}
    </section>
  );
}

const PAST_PREFLIGHT = new Set(["approaching", "streaming", "braking"]);

function Preflight(): JSX.Element {
  const items = preflight(cellState.value, answered.value);
  const held = items.filter((item) => item.ok === true).length;
  const stopping = items.some((item) => item.ok === false);
  const known = items.filter((item) => item.ok !== null).length;
  return (
    <details class="options" open={stopping}>
      <summary class={stopping ? "bad" : held === items.length ? "good" : ""}>
        Preflight: {held === known ? `${held === items.length ? "all " : ""}${held} checks are in order` : `${held} of ${known} checks are in order`}
        {known < items.length ? `, ${items.length - known} not known yet` : ""}
      </summary>
      <ul class="preflight" aria-label="Preflight">
        {items.map((item) => (
          <li key={item.text} class={item.ok === null ? "unknown" : item.ok ? "ok" : "no"}>
            <Icon name={item.ok === null ? "wait" : item.ok ? "ok" : "no"} />
            <span>
              {item.text}
              <span class="sr-only">{item.ok === null ? ": not known yet" : item.ok ? ": in order" : ": in the way"}</span>
            </span>
          </li>
        ))}
      </ul>
    </details>
  );
}

function RunView({ run }: { run: Run }): JSX.Element {
  const ended = run.state === "finished";
  const tone = ended ? outcomeTone(run.outcome) : "busy";
  const plan = runPlan.value?.id === run.planId ? runPlan.value : null;
  return (
    <div class="run">
      <RunHead run={run} plan={plan} />
      <ol class="phases" aria-label="Phases">
        {PHASES.map((phase) => (
          <li key={phase} class={phaseClass(phase, run)} aria-current={phase === run.state ? "step" : undefined}>
            {phaseWords(phase, run)}
          </li>
        ))}
      </ol>
      <p class={`outcome ${tone}`} role="status">
        {ended ? outcomeWords(run) : run.stopping ? "Stopping …" : `${phaseWords(run.state, run)} …`}
        {run.outcome ? <code class="sr-only">{run.outcome}</code> : null}
      </p>
      {run.reason ? <p class="soft">{sentence(plainWords(run.reason))}</p> : null}
      {ended && run.outcome !== "completed" && run.outcome !== "aborted" ? <p>{adviceAfter(run.outcome, run.reason)}</p> : null}
      {run.samples.length > 1 && !run.dryRun ? <Tracking samples={run.samples} plan={plan} /> : null}
      {ended ? <Numbers run={run} plan={plan} /> : null}
    </div>
  );
}

/** Which throw it is: when, where to, and by which id; a past one can be left, or asked for again. */
function RunHead({ run, plan }: { run: Run; plan: Plan | null }): JSX.Element {
  const aim = plan && aimOf(plan);
  return (
    <div class="run-head">
      <p class="soft">
        {run.createdAt ? dateWords(run.createdAt) : ""}
        {aim ? `, to ${placeWords(aim, floorZ.value)}` : ""}
        {" · "}
        <a href={hashOf({ kind: "execution", id: run.id })} aria-label={`Execution ${run.id}`}>
          <code>{run.id}</code>
        </a>
      </p>
      {viewing.value === run.id ? (
        <div class="actions">
          <button type="button" class="quiet small" onClick={leavePast}>
            Back to the request
          </button>
          {plan ? (
            <button type="button" class="quiet small" onClick={() => takeRequest(plan)}>
              Take its request
            </button>
          ) : null}
        </div>
      ) : null}
    </div>
  );
}

function phaseWords(phase: string, run: Run): string {
  return phase === "streaming" && run.dryRun ? "Rehearsing" : (PHASE_WORDS[phase] ?? phase);
}

function phaseClass(phase: string, run: Run): string {
  if (wentThrough(phase, run)) return "done";
  return phase === run.state ? "now" : "later";
}

const WIDTH = 300;
const HEIGHT = 64;

/** How far the arm is from its plan, joint by joint, as it comes in. */
function Tracking({ samples, plan }: { samples: readonly Sample[]; plan: Plan | null }): JSX.Element {
  const errors = samples.map((sample) => sample.positions.map((q, j) => 1000 * (q - (sample.planned[j] ?? q))));
  const largest = Math.max(0.05, ...errors.flat().map(Math.abs));
  const from = samples[0]?.clock_s ?? 0;
  const to = Math.max(plan?.duration_s ?? 0, samples.at(-1)?.clock_s ?? 1);
  const x = (t: number): number => (WIDTH * (t - from)) / Math.max(1e-3, to - from);
  const y = (error: number): number => HEIGHT / 2 - (HEIGHT / 2 - 3) * (error / largest);
  return (
    <figure class="tracking">
      <figcaption>
        Measured less planned, at most {figure(largest, 2)} mrad
      </figcaption>
      <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" role="img" aria-label={`Tracking error of six joints, at most ${figure(largest, 2)} mrad`}>
        <line class="zero" x1="0" x2={WIDTH} y1={HEIGHT / 2} y2={HEIGHT / 2} />
        {JOINTS.map((name, j) => (
          <polyline key={name} class={`line-${j}`} points={samples.map((sample, i) => `${x(sample.clock_s).toFixed(1)},${y(errors[i]?.[j] ?? 0).toFixed(1)}`).join(" ")} />
        ))}
      </svg>
    </figure>
  );
}

function Numbers({ run, plan }: { run: Run; plan: Plan | null }): JSX.Element {
  const observed = observedError(run.id, plan);
  const metrics = run.metrics ?? {};
  const rest = metricRows(metrics);
  return (
    <>
      <dl class="key-numbers">
        {keyNumbers(run, observed, plan).map(({ label, value, note }) => (
          <div key={label}>
            <dt>{label}</dt>
            <dd>
              {value}
              {note ? <small>{note}</small> : null}
            </dd>
          </div>
        ))}
      </dl>
      {run.metrics?.["released"] === true && toBeReported.value !== run.id ? <LandingReports key={run.id} id={run.id} plan={plan} /> : null}
      {rest.length > 0 ? (
        <details class="options">
          <summary>Everything that was measured</summary>
          <dl class="all-numbers">
            {rest.map(([name, value]) => (
              <div key={name}>
                <dt>{name}</dt>
                <dd>{value}</dd>
              </div>
            ))}
          </dl>
        </details>
      ) : null}
    </>
  );
}

/** Horizontal distance of the newest observed landing from the target [m]; null without either. */
export function observedError(id: string, plan: Plan | null): number | null {
  const offset = offsetFrom(plan && aimOf(plan), landings.value[id] ?? []);
  return offset && Math.hypot(...offset);
}
