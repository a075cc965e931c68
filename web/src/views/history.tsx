// Past throws of the chosen cell: a list in pages, a scatter of the landings round their targets, and what was learnt of it.

import type { JSX } from "preact";

import { call } from "../service/client";
import { save } from "../service/save";
import type { Execution } from "../service/types";
import { newestResult } from "../state/landing-report";
import { aimOf, placeWords } from "../state/machine";
import { filterBy, listed, newer, older } from "../state/past";
import { showPast } from "../state/follow";
import { ellipseOf, type Offset, offsetFrom } from "../state/scatter";
import { cellName, compared, failed, floorZ, history, landings, notice, targets, viewing } from "../state/store";
import { dateWords, landingWords, length, OUTCOME_WORDS, outcomeTone, outcomeWords } from "../state/words";
import { observedError } from "./execution";
import { Comparison } from "./comparison";
import { SelectField } from "./fields";
import { Icon } from "./icons";
import { Profiles } from "./profiles";

export function HistorySection(): JSX.Element {
  const own = history.value?.filter((run) => run.cell === cellName.value) ?? null;
  const page = listed();
  return (
    <section class="card history" aria-labelledby="history-title">
      <h2 id="history-title">History</h2>
      {page === null ? <p class="soft">Loading …</p> : null}
      {own?.length === 0 && page?.outcome === "" ? <p class="soft">Nothing has been thrown on {cellName.value} yet.</p> : null}
      {own && own.length > 0 && page ? (
        <div class="past">
          <Scatter runs={own} />
          <div class="listed">
            <Filter chosen={page.outcome} />
            {page.runs.length > 0 ? <Table runs={page.runs} /> : <p class="soft">None ended so.</p>}
            <div class="actions">
              <button type="button" class="quiet small" disabled={page.before.length === 0} onClick={() => void newer()}>
                Newer
              </button>
              <button type="button" class="quiet small" disabled={page.next === null} onClick={() => void older()}>
                Older
              </button>
              <span class="hint">Page {page.before.length + 1}</span>
            </div>
          </div>
        </div>
      ) : null}
      <Comparison />
      <Profiles />
    </section>
  );
}

function Filter({ chosen }: { chosen: string }): JSX.Element {
  const outcomes = Object.entries(OUTCOME_WORDS);
  return <SelectField label="Outcome" options={[["", "all"], ...outcomes]} value={chosen} onChoose={(outcome) => void filterBy(outcome)} />;
}

function Table({ runs }: { runs: readonly Execution[] }): JSX.Element {
  return (
    <div class="scroll" tabIndex={0} role="group" aria-label="Past throws">
      <table>
        <thead>
          <tr>
            <th scope="col">Time</th>
            <th scope="col">Target</th>
            <th scope="col">Outcome</th>
            <th scope="col" class="number">Landing error</th>
            <th scope="col" class="number">Missed ticks</th>
            <th scope="col">Recording</th>
            <th scope="col">Compare</th>
          </tr>
        </thead>
        <tbody>
          {runs.map((run) => (
            <tr key={run.id} class={run.id === viewing.value ? "shown" : ""}>
              <td>
                <button type="button" class="link" aria-label={`Show the execution of ${dateWords(run.created_at)}`} onClick={() => void show(run.id)}>
                  {dateWords(run.created_at)}
                </button>
              </td>
              <td class="place">{targetWords(run)}</td>
              <td class={run.outcome ? outcomeTone(run.outcome) : "busy"}>
                {run.outcome ? outcomeWords({ ...run, dryRun: run.dry_run }) : "Running"}
              </td>
              <td class="number">
                {length(errorOf(run))}
                <Result run={run} />
              </td>
              <td class="number">{run.metrics?.["missed_ticks"] === undefined ? "–" : String(run.metrics["missed_ticks"])}</td>
              <td>
                {run.state === "finished" && run.outcome !== "refused" ? (
                  <>
                    <Download id={run.id} media="application/octet-stream" suffix="mcap" />{" "}
                    <Download id={run.id} media="text/csv" suffix="csv" />
                  </>
                ) : null}
              </td>
              <td>
                {run.state === "finished" ? (
                  <input
                    type="checkbox" aria-label={`Compare the execution of ${dateWords(run.created_at)}`} checked={compared.value.includes(run.id)}
                    onChange={() => compare(run.id)}
                  />
                ) : null}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Shows a past throw, and the scene that it is in. */
async function show(id: string): Promise<void> {
  try {
    await showPast(id);
    scrollTo({ top: 0 });
  } catch (error) {
    notice.value = { kind: "bad", text: failed(error) };
  }
}

function targetWords(run: Execution): string {
  const plan = targets.value[run.plan_id];
  const aim = plan && aimOf(plan);
  return aim ? placeWords(aim, floorZ.value) : "–";
}

/** Chooses an execution for the comparison, or leaves it out; a third takes the place of the first. */
function compare(id: string): void {
  compared.value = compared.value.includes(id) ? compared.value.filter((other) => other !== id) : [...compared.value, id].slice(-2);
}

function errorOf(run: Execution): number | null {
  const measured = run.metrics?.["landing_error_m"];
  return typeof measured === "number" ? measured : observedError(run.id, targets.value[run.plan_id] ?? null);
}

/** Whether the target was hit, as somebody reported it. */
function Result({ run }: { run: Execution }): JSX.Element | null {
  const found = newestResult(landings.value[run.id] ?? []);
  return found && <small class={found.result === "hit" ? "good" : found.result === "miss" ? "bad" : ""}>{landingWords(found)}</small>;
}

function Download({ id, media, suffix }: { id: string; media: string; suffix: string }): JSX.Element {
  const fetchAndSave = async (): Promise<void> => {
    try {
      const response = await call("GET", `/executions/${id}/recording`, { accept: media });
      save(await response.blob(), `${id}.${suffix}`);
    } catch (error) {
      notice.value = { kind: "bad", text: failed(error) };
    }
  };
  return (
    <button type="button" class="link" aria-label={`Download the recording as ${suffix}`} onClick={() => void fetchAndSave()}>
      <Icon name="download" /> {suffix}
    </button>
  );
}

/** Landings less their targets, seen from above. */
function offsets(runs: readonly Execution[]): Offset[] {
  return runs.flatMap((run) => {
    const plan = targets.value[run.plan_id];
    const release = plan?.request["release"] as { kind?: string } | undefined;
    const aim = plan && release?.kind === "target" ? aimOf(plan) : null;
    const offset = offsetFrom(aim, landings.value[run.id] ?? []);
    return offset ? [offset] : [];
  });
}

const RINGS_M = [0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2];

function Scatter({ runs }: { runs: readonly Execution[] }): JSX.Element | null {
  const points = offsets(runs);
  if (points.length === 0) return null;
  const farthest = Math.max(...points.map(([x, y]) => Math.hypot(x, y)));
  const outer = RINGS_M.find((ring) => ring >= farthest * 1.05) ?? farthest;
  const inner = outer / 2;
  const scale = 44 / outer;
  const ellipse = ellipseOf(points);
  return (
    <figure class="scatter">
      <svg viewBox="-50 -50 100 100" role="img" aria-label={`${points.length} landings round their targets, the farthest ${length(farthest)} away`}>
        <circle class="ring" r={inner * scale} />
        <circle class="ring" r={outer * scale} />
        <path class="cross" d="M-3 0H3M0-3V3" />
        {ellipse ? (
          <ellipse
            class="spread" cx={ellipse.center[0] * scale} cy={-ellipse.center[1] * scale} rx={Math.max(0.6, ellipse.axes[0] * scale)}
            ry={Math.max(0.6, ellipse.axes[1] * scale)} transform={`rotate(${-ellipse.turn_deg} ${ellipse.center[0] * scale} ${-ellipse.center[1] * scale})`}
          />
        ) : null}
        {points.map(([x, y], i) => <circle key={i} class={`dot ${i === 0 ? "newest" : ""}`} cx={x * scale} cy={-y * scale} r={i === 0 ? 2 : 1.5} />)}
      </svg>
      <figcaption>
        {points.length} {points.length === 1 ? "landing" : "landings"}; the rings are {length(inner)} and {length(outer)} from the target
        {ellipse ? "; ellipse: two standard deviations" : ""}.
      </figcaption>
    </figure>
  );
}
