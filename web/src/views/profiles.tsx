// What was learnt of the cell: each profile with what it rests on before it is adopted.

import type { JSX } from "preact";

import type { ProfileSummary } from "../service/types";
import { adopt, learn, revert } from "../state/actions";
import { counted } from "../state/landing-report";
import { cellName, history, landings, profiles } from "../state/store";
import { dateWords, figure, length, plainWords } from "../state/words";

const LISTED = 8;

export function Profiles(): JSX.Element | null {
  const list = profiles.value;
  if (list === null || list.cell !== cellName.value) return null;
  const used = list.profiles.find((profile) => profile.id === list.adopted) ?? null;
  return (
    <details class="options profiles">
      <summary>What was learnt of this cell</summary>
      <p class="soft">{used ? `In use: ${profileWords(used)}.` : "In use: the cell file's numbers."}</p>
      {list.warning ? <p class="bad">{plainWords(list.warning)}</p> : null}
      <Known />
      {list.profiles.length > 0 ? (
        <ul class="profile-list" aria-label="Profiles">
          {list.profiles.slice(0, LISTED).map((profile, i) => (
            <Profile key={profile.id} profile={profile} isUsed={profile.id === list.adopted} isNewest={i === 0} />
          ))}
        </ul>
      ) : null}
      {used ? (
        <div class="actions">
          <button type="button" class="quiet small" onClick={() => void revert()}>
            Revert to the cell file
          </button>
        </div>
      ) : null}
    </details>
  );
}

/** What a profile would rest on now, besides the throws of a guided calibration. */
function Known(): JSX.Element {
  const thrown = (history.value ?? []).filter((run) => run.cell === cellName.value && run.metrics?.["released"] === true);
  const seen = thrown.filter((run) => counted(landings.value[run.id] ?? []).length > 0);
  return (
    <>
      <p class="soft">
        Ordinary throws teach, too: of the newest {thrown.length}, {seen.length} have a reported landing.
      </p>
      <div class="actions">
        <button type="button" class="quiet small" onClick={() => void learn()}>
          Estimate a profile
        </button>
      </div>
    </>
  );
}

function Profile({ profile, isUsed, isNewest }: { profile: ProfileSummary; isUsed: boolean; isNewest: boolean }): JSX.Element {
  return (
    <li class={isUsed ? "used" : ""}>
      <p>
        <b>{dateWords(profile.created_at)}</b>
        {isUsed ? <span class="badge">in use</span> : null}
      </p>
      <ProfileFacts profile={profile} />
      {isUsed ? null : (
        <button type="button" class="quiet small" onClick={() => void adopt(profile.id)}>
          {isNewest ? "Adopt the newest" : `Adopt that of ${dateWords(profile.created_at)}`}
        </button>
      )}
    </li>
  );
}

/** The numbers of a profile, and what they rest on. */
export function ProfileFacts({ profile }: { profile: ProfileSummary }): JSX.Element {
  const { evidence, landing_error_before_m: before, landing_error_after_m: after } = profile;
  const counts = `${evidence.throws.length} throws with ${evidence.landings.length} landings, ${evidence.timing.length} runs for the arm's timing`;
  return (
    <>
      <p>{numbersWords(profile)}</p>
      <p class="soft">
        Rests on {counts}.{" "}
        {typeof before === "number" && typeof after === "number" ? `Landings were off by ${length(before)}; it explains them to ${length(after)}.` : ""}
      </p>
      <Throws list={evidence.doubted ?? []} words={(count) => `${count} doubted: most likely a mistaken report`} />
      <Throws list={evidence.not_used ?? []} words={(count) => `${count} ${count === 1 ? "throw" : "throws"} not used`} />
    </>
  );
}

type NamedThrows = NonNullable<ProfileSummary["evidence"]["not_used"]>;

/** Throws with the reason why they count for little, or for nothing. */
function Throws({ list, words }: { list: NamedThrows; words: (count: number) => string }): JSX.Element | null {
  if (list.length === 0) return null;
  return (
    <details>
      <summary>{words(list.length)}</summary>
      <ul class="hint">
        {list.map(({ execution_id, reason }) => (
          <li key={execution_id}>
            <a href={`#/execution/${execution_id}`}>{execution_id.slice(-6)}</a>: {plainWords(reason)}
          </li>
        ))}
      </ul>
    </details>
  );
}

export const ms = (seconds: number): string => `${figure(seconds * 1000, 3)} ms`;

export function withStd(value: number, std: number | null): string {
  return std === null ? ms(value) : `${ms(value)} ± ${figure(std * 1000, 2)} ms`;
}

function numbersWords({ lag_s, lag_std_s, delay_s, delay_std_s, jitter_s, jitter_std_s }: ProfileSummary): string {
  return `Lag ${withStd(lag_s, lag_std_s)}; gripper ${withStd(delay_s, delay_std_s)}, jitter ${withStd(jitter_s, jitter_std_s)}.`;
}

export function profileWords(profile: ProfileSummary): string {
  return `lag ${ms(profile.lag_s)}, gripper ${ms(profile.delay_s)} ± ${ms(profile.jitter_s)}, of ${dateWords(profile.created_at)}`;
}
