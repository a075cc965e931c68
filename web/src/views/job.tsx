// The newest job of the chosen cell: what it does now, its queue, and the chart of the shift.

import { useSignal } from "@preact/signals";
import type { JSX } from "preact";

import { type Shift, shiftOf } from "../model/shift";
import type { Job, ObjectResult } from "../service/types";
import { askOfJob, type JobAction, saveResults, shownJob } from "../state/job";
import { length } from "../state/words";
import { Icon } from "./icons";

const ROWS = 10;
const PARQUET = "application/vnd.apache.parquet";

export function JobSection(): JSX.Element | null {
  const shown = shownJob.value;
  if (shown === null) return null;
  const { job, objects } = shown;
  const shift = shiftOf(objects);
  return (
    <section class="card job" aria-labelledby="job-title">
      <div class="who">
        <h2 id="job-title">Job</h2>
        <Actions job={job} />
      </div>
      <progress max={job.total} value={job.done} aria-label="Objects that are done" />
      <p role="status">{stateWords(job)}</p>
      <p class="soft">{recordWords(job)}</p>
      <div class="past">
        {shift ? <Chart shift={shift} /> : null}
        <Queue job={job} objects={objects} />
      </div>
    </section>
  );
}

function Actions({ job }: { job: Job }): JSX.Element {
  const can: readonly (readonly [JobAction, string, boolean])[] = [
    ["pause", "Pause", (job.state === "running" || job.state === "queued") && !job.pause_requested],
    ["resume", "Resume", job.state === "paused" || job.pause_requested || job.outcome === "stopped"],
    ["cancel", "Cancel job", job.state !== "finished" && !job.cancel_requested],
  ];
  return (
    <div class="actions">
      {can
        .filter(([, , possible]) => possible)
        .map(([action, text]) => (
          <button key={action} type="button" class="quiet small" onClick={() => void askOfJob(job.id, action)}>
            {text}
          </button>
        ))}
    </div>
  );
}

/** What the job does now, or how it ended. */
export function stateWords(job: Job): string {
  if (job.state === "finished") return [JOB_OUTCOMES[job.outcome ?? ""] ?? job.outcome, job.reason].filter(Boolean).join(": ");
  const { current } = job;
  if (job.state === "paused") return "The job is paused.";
  const ends = job.cancel_requested ? " It is cancelled after this motion." : job.pause_requested ? " It pauses after this motion." : "";
  if (current === null) return job.state === "running" ? "The next motion is being planned." : `The job is ${job.state}.${ends}`;
  const next = current.next_pick === null ? "home" : `pick ${current.next_pick}`;
  const attempt = current.attempt > 1 ? `, attempt ${current.attempt}` : "";
  const does = current.kind === "throw" ? `Throwing from pick ${current.pick} at target ${current.target}${attempt}, then to ${next}.` : `On the way to ${next}.`;
  return `${does}${ends}`;
}

const JOB_OUTCOMES: Readonly<Record<string, string>> = { completed: "All objects are done", cancelled: "Cancelled", stopped: "Stopped" };

/** The figures of the shift so far. */
export function recordWords({ record, done, total }: Job): string {
  const parts = [`${done} of ${total} objects are done`];
  if (record.hit_share !== null && record.hit_interval !== null) {
    const [low, high] = record.hit_interval.map(percent);
    parts.push(`${record.hits} of ${record.landings_seen} landings seen are hits (${percent(record.hit_share)}; ${low} to ${high} with 95 % confidence)`);
  }
  const misses = Object.entries(record.misses).map(([cause, n]) => `${n} ${RESULT_WORDS[cause]?.toLowerCase() ?? cause}`);
  if (misses.length > 0) parts.push(misses.join(", "));
  if (record.cycles_per_hour !== null) parts.push(`${Math.round(record.cycles_per_hour)} cycles an hour`);
  return `${parts.join("; ")}.`;
}

const percent = (share: number): string => `${Math.round(100 * share)} %`;

const RESULT_WORDS: Readonly<Record<string, string>> = {
  waiting: "Waiting",
  moving: "Moving",
  hit: "Hit",
  miss: "Missed",
  thrown: "Thrown, not seen to land",
  missed_grip: "Not gripped",
  not_planned: "No motion found",
  kept: "Still in the gripper",
  unknown: "In the gripper, or thrown",
};
const TONES: Readonly<Record<string, string>> = { hit: "good", miss: "bad", missed_grip: "bad", not_planned: "bad", kept: "bad", unknown: "bad", moving: "busy" };

function Queue({ job, objects }: { job: Job; objects: readonly ObjectResult[] }): JSX.Element {
  const asked = useSignal<number | null>(null); // page that a person chose; null: the current object's
  const pages = Math.max(1, Math.ceil(objects.length / ROWS));
  const current = Math.max(0, objects.findIndex((each) => each.result === "moving" || each.result === "waiting"));
  const page = Math.min(asked.value ?? Math.floor(current / ROWS), pages - 1);
  const rows = objects.slice(page * ROWS, (page + 1) * ROWS);
  return (
    <div class="listed">
      <div class="scroll" tabIndex={0} role="group" aria-label="Objects of the job">
        <table>
          <thead>
            <tr>
              <th scope="col" class="number">Pick</th>
              <th scope="col">Object</th>
              <th scope="col" class="number">Target</th>
              <th scope="col">Result</th>
              <th scope="col" class="number">Landing error</th>
              <th scope="col">Where it is</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((each) => (
              <tr key={each.pick}>
                <td class="number">{each.pick}</td>
                <td>{each.object ?? "–"}</td>
                <td class="number">{each.target ?? "–"}</td>
                <td class={TONES[each.result] ?? ""}>
                  {RESULT_WORDS[each.result] ?? each.result}
                  {each.attempts > 1 ? <small>{each.attempts} attempts</small> : null}
                  {each.reason ? <small class="soft">{each.reason}</small> : null}
                </td>
                <td class="number">{length(each.error_m)}</td>
                <td>{each.object_at ?? "–"}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      <div class="actions">
        <button type="button" class="quiet small" disabled={page === 0} onClick={() => (asked.value = page - 1)}>
          Before
        </button>
        <button type="button" class="quiet small" disabled={page >= pages - 1} onClick={() => (asked.value = page + 1)}>
          After
        </button>
        <Download id={job.id} media="text/csv" suffix="csv" />
        <Download id={job.id} media={PARQUET} suffix="parquet" />
      </div>
    </div>
  );
}

function Download({ id, media, suffix }: { id: string; media: string; suffix: string }): JSX.Element {
  return (
    <button type="button" class="link" aria-label={`Download the job's results as ${suffix}`} onClick={() => void saveResults(id, media, suffix)}>
      <Icon name="download" /> {suffix}
    </button>
  );
}

const WIDTH = 180; // of the drawing's own units
const HEIGHT = 100;

/** Landing errors over the time of the shift; what was put aside is a stroke on the axis. */
function Chart({ shift }: { shift: Shift }): JSX.Element {
  const x = (minute: number): number => (WIDTH * minute) / shift.minutes;
  const y = (error: number): number => HEIGHT * (1 - error / shift.error_m);
  const hits = shift.landings.filter((each) => each.isHit).length;
  const words = `${hits} hits and ${shift.landings.length - hits} misses in ${shift.minutes.toFixed(1)} minutes; ${shift.aside.length} put aside`;
  return (
    <figure class="scatter shift">
      <svg viewBox={`-4 -4 ${WIDTH + 8} ${HEIGHT + 8}`} role="img" aria-label={words}>
        <path class="ring" d={`M0 ${HEIGHT}H${WIDTH}M0 ${HEIGHT / 2}H${WIDTH}M0 0H${WIDTH}`} />
        {shift.landings.map((each) => <circle key={each.pick} class={each.isHit ? "dot" : "dot missed"} cx={x(each.minute)} cy={y(each.error_m)} r={1.6} />)}
        {shift.aside.map((each) => <path key={each.pick} class="aside" d={`M${x(each.minute)} ${HEIGHT}v-6`} />)}
      </svg>
      <figcaption>
        Landing error from 0 to {length(shift.error_m)} over {shift.minutes.toFixed(1)} min; misses are red, strokes on the axis are objects put aside.
      </figcaption>
    </figure>
  );
}
