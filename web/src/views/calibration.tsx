// The guided calibration: its steps, what moves next and where it may fly, what was found so far, and what came of it.

import type { ComponentChildren, JSX } from "preact";

import type { Plan } from "../service/types";
import {
  adoptAndGoOn, asked, cancelCalibration, closeCalibration, goOn, motionCount, moves, openCalibration, seeking, skip, toBeReported,
} from "../state/calibrate";
import { type Calibration, type Lag, type Move, moveWords, type Odds, STEPS, type Step, THROWS, THROWS_MIN } from "../state/calibration";
import { counted } from "../state/landing-report";
import { placeWords, throwLabel } from "../state/machine";
import { calibration, cell, cellName, driving, floorZ, guided, hindrance, isReal, landings, profiles, running, runPlan, targets } from "../state/store";
import { figure, length, planWords, progressWords } from "../state/words";
import { observedError } from "./execution";
import { LandingReports } from "./landing";
import { ms, ProfileFacts, profileWords, withStd } from "./profiles";
import { AskOnceMore } from "./throw";

export function CalibrationSection(): JSX.Element {
  const now = calibration.value;
  const isOwn = now !== null && guided.value;
  const used = profiles.value?.cell === cellName.value ? profiles.value.profiles.find((known) => known.id === profiles.value?.adopted) : undefined;
  return (
    <section class="card calibration" aria-labelledby="calibration-title">
      <div class="who">
        <h2 id="calibration-title">Calibration</h2>
        {isOwn ? (
          <button type="button" class="quiet small" disabled={driving.value !== null} onClick={closeCalibration}>
            {now.step === "done" ? "Close the calibration" : "Leave the calibration"}
          </button>
        ) : (
          <button type="button" class="quiet small" disabled={cell.value === null || driving.value !== null} onClick={openCalibration}>
            Calibrate …
          </button>
        )}
      </div>
      {isOwn ? <Guide now={now} /> : <p class="soft">{used ? `In use: ${profileWords(used)}.` : "This cell is not calibrated yet: how well its throws hit is not known."}</p>}
    </section>
  );
}

const TITLES: Readonly<Record<Exclude<Step, "done">, string>> = {
  motions: "Small motions",
  lag: "The arm’s lag",
  throws: "Throws",
  profile: "The profile",
};

function Guide({ now }: { now: Calibration }): JSX.Element {
  const at = STEPS.indexOf(now.step);
  return (
    <>
      <ol class="guide" aria-label="Steps of the calibration">
        {Object.entries(TITLES).map(([step, title], i) => (
          <li key={step} class={i < at ? "done" : i === at ? "now" : "later"} aria-current={i === at ? "step" : undefined}>
            <b>{title}</b>
            {i < at ? <span class="soft"> {foundWords(step as Step, now)}</span> : null}
            {i === at ? <StepBody now={now} /> : null}
          </li>
        ))}
      </ol>
      {now.step === "done" ? <Done now={now} /> : null}
      <Status now={now} />
      <Ask now={now} />
    </>
  );
}

/** What a step that is over came to. */
function foundWords(step: Step, now: Calibration): string {
  if (step === "motions") return now.motions.length > 0 ? `${now.motions.length} done` : "skipped";
  if (step === "lag") return now.lag === null ? "not measured" : lagWords(now.lag);
  if (step === "throws") return `${now.throws.length} thrown`;
  return profiles.value?.adopted === now.profile ? "in use" : "not adopted";
}

function lagWords({ assumed_s, measured_s, std_s, isOther }: Lag): string {
  if (measured_s === null) return "no run shows it";
  return `${withStd(measured_s, std_s)}; plans assume ${ms(assumed_s)}${isOther ? "" : ", near enough"}`;
}

function StepBody({ now }: { now: Calibration }): JSX.Element | null {
  if (now.step === "motions") return <Motions now={now} />;
  if (now.step === "throws") return <Throws now={now} />;
  return now.step === "done" ? null : <Outcome now={now} />;
}

function Motions({ now }: { now: Calibration }): JSX.Element {
  const known = moves.value;
  const count = motionCount.value;
  const turn = known ? ` by up to ${figure((known.amplitude_rad * 180) / Math.PI, 2)}°` : "";
  return (
    <>
      <p>
        The arm goes to its home and moves {count} times about it: every joint{turn}, then to rest. No object is needed; the gripper stays as it is.
        They show how long after a command the arm moves.
      </p>
      <Found moves={now.motions} words={(move) => (move.lag_s === null ? "shows no lag" : `lag ${ms(move.lag_s)}`)} name="Motion" />
      <Buttons>
        <MoveButton label={now.motions.length === 0 ? `Move ${now.cell}: ${count} small motions` : `Go on: ${moveWords(now, count).toLowerCase()}`} />
        <StillButton label={now.motions.length === 0 ? "Skip the motions" : "These are enough"} onClick={() => void skip()} />
      </Buttons>
    </>
  );
}

function Throws({ now }: { now: Calibration }): JSX.Element {
  const reach = moves.value?.reach_m;
  const far = reach ? `, ${length(reach[0])} to ${length(reach[1])} from its base` : "";
  const real = isReal.value;
  const nextThrow = moveWords(now, 0);
  return (
    <>
      <p>
        {THROWS} throws, as soon as the arm can, to targets on the floor <b>all around the arm</b>{far}. Where they land shows when the gripper lets go.{" "}
        {real ? "Before each one you are asked for an object in the gripper, and after it where it landed." : "The simulated camera reports where they land."}
      </p>
      <Found moves={now.throws} words={landedWords} name="Throw" />
      <ToReport now={now} />
      <Buttons>
        <MoveButton label={real ? `${nextThrow} on ${now.cell} …` : now.throws.length === 0 ? `Throw ${THROWS} times on ${now.cell}` : `Go on: ${nextThrow.toLowerCase()}`} />
        {now.throws.length >= THROWS_MIN ? <StillButton label="These are enough" onClick={() => void skip()} /> : null}
      </Buttons>
    </>
  );
}

/** How far from its target a throw landed, as somebody or a camera saw it. */
function landedWords({ id, planId }: Move): string {
  const seen = counted(landings.value[id] ?? []);
  const off = observedError(id, planOf(planId));
  if (off !== null) return `landed ${length(off)} off`;
  return seen.at(-1)?.result ?? "its landing was not seen";
}

function planOf(planId: string): Plan | null {
  return targets.value[planId] ?? (runPlan.value?.id === planId ? runPlan.value : null);
}

/** The landing that only a person can report. */
function ToReport({ now }: { now: Calibration }): JSX.Element | null {
  const last = now.throws.at(-1);
  if (last === undefined || toBeReported.value !== last.id) return null;
  const isKnown = counted(landings.value[last.id] ?? []).length > 0;
  return (
    <div class="to-report">
      <p>
        <b>Where did throw {now.throws.length} land?</b> {isKnown ? "Reported." : "Where it was not seen, go on without a report."}
      </p>
      <LandingReports key={last.id} id={last.id} plan={planOf(last.planId)} open={!isKnown} />
    </div>
  );
}

/** What a step showed, with what it rests on; a person decides whether plans use it. */
function Outcome({ now }: { now: Calibration }): JSX.Element {
  const profile = profiles.value?.profiles.find((known) => known.id === now.profile) ?? null;
  const isLag = now.step === "lag";
  if (profile === null) {
    return (
      <>
        <ToReport now={now} />
        <Buttons>
          <StillButton label="Estimate the profile" onClick={() => void goOn()} />
        </Buttons>
      </>
    );
  }
  const isWorth = !isLag || now.lag?.isOther === true;
  const onwards = isLag ? "Go on without it" : "Leave it, and finish";
  return (
    <>
      {isLag && now.lag ? <p>Measured: {lagWords(now.lag)}.{now.lag.isOther ? " Adopt it before you throw: it moves every landing." : ""}</p> : null}
      {isLag ? null : <OddsWords now={now} />}
      <ProfileFacts profile={profile} />
      <Buttons>
        <button type="button" class={`small ${isWorth ? "primary" : "quiet"}`} disabled={driving.value !== null} onClick={() => void adoptAndGoOn()}>
          {isLag ? "Adopt the lag" : "Adopt"}
        </button>
        <button type="button" class={`small ${isWorth ? "quiet" : "primary"}`} disabled={driving.value !== null} onClick={() => void skip()}>
          {onwards}
        </button>
      </Buttons>
    </>
  );
}

function OddsWords({ now }: { now: Calibration }): JSX.Element | null {
  const odds = now.odds;
  if (odds === null) return null;
  return (
    <>
      <p class="soft">
        Odds to land within {length(odds.after.radius_m)} of {placeWords(odds.target, floorZ.value)}, the target in the form:
      </p>
      <dl class="key-numbers">
        <div>
          <dt>Before</dt>
          <dd>{odds.before === null ? <>not known<small>timing ±20 ms</small></> : <OddsNumber odds={odds.before} />}</dd>
        </div>
        <div>
          <dt>With this profile</dt>
          <dd>
            <OddsNumber odds={odds.after} />
          </dd>
        </div>
      </dl>
    </>
  );
}

function OddsNumber({ odds }: { odds: Odds }): JSX.Element {
  const [low, high] = odds.interval.map((p) => figure(p * 100, 2));
  return (
    <>
      {figure(odds.value * 100, 2)} %<small>{low} to {high} %</small>
    </>
  );
}

function Done({ now }: { now: Calibration }): JSX.Element {
  const used = profiles.value?.profiles.find((known) => known.id === now.profile && known.id === profiles.value?.adopted);
  return (
    <>
      <p class="good">{used ? `In use: ${profileWords(used)}.` : "Nothing was adopted."}</p>
      <OddsWords now={now} />
      {used ? <p class="soft">Plans are made with it from now on: plan again.</p> : null}
    </>
  );
}

function Found({ moves: list, words, name }: { moves: readonly Move[]; words: (move: Move) => string; name: string }): JSX.Element | null {
  if (list.length === 0) return null;
  return (
    <ul class="found" aria-label="Found so far">
      {list.map((move, i) => (
        <li key={move.id}>
          <a href={`#/execution/${move.id}`}>{name} {i + 1}</a>: {words(move)}
        </li>
      ))}
    </ul>
  );
}

function Buttons({ children }: { children: ComponentChildren }): JSX.Element {
  const reason = hindrance.value;
  const isDriven = driving.value !== null;
  return (
    <>
      <div class="actions">
        {isDriven ? (
          <button type="button" class="quiet small" onClick={cancelCalibration}>
            Cancel
          </button>
        ) : (
          children
        )}
      </div>
      {reason !== null && !isDriven ? <p class="why">{reason}</p> : null}
    </>
  );
}

/** What moves the arm; a real one asks once more. */
function MoveButton({ label }: { label: string }): JSX.Element {
  const isFree = hindrance.value === null && !running.value && driving.value === null;
  return (
    <button type="button" class={`small ${isReal.value ? "real" : "primary"}`} disabled={!isFree} onClick={() => void goOn()}>
      {label}
    </button>
  );
}

function StillButton({ label, onClick }: { label: string; onClick: () => void }): JSX.Element {
  return (
    <button type="button" class="quiet small" disabled={running.value} onClick={onClick}>
      {label}
    </button>
  );
}

/** What it does just now, or why it stands still. */
function Status({ now }: { now: Calibration }): JSX.Element {
  const told = seeking.value;
  return (
    <p class={now.trouble === null ? "soft" : "bad"} role="status">
      {driving.value !== null ? `${doingWords(now)}${told === null ? " …" : `. ${progressWords(told)}`}` : now.trouble === null ? "" : `${now.trouble} What was found is kept.`}
    </p>
  );
}

function doingWords(now: Calibration): string {
  if (now.running !== null) return `${moveWords(now, motionCount.value)} is under way`;
  if (now.step === "lag" || now.step === "profile") return "Estimating the profile";
  if (asked.value !== null) return `${moveWords(now, motionCount.value)} waits for your word`;
  return `Planning ${moveWords(now, motionCount.value).toLowerCase()}`;
}

function Ask({ now }: { now: Calibration }): JSX.Element | null {
  const question = asked.value;
  if (question === null) return null;
  const load = now.step === "throws" ? "Put an object into the gripper first. " : "No object is needed. ";
  const what = now.step === "throws" ? throwLabel(question.plan, floorZ.value) : "A small motion about its home";
  return (
    <AskOnceMore
      what={`${moveWords(now, motionCount.value)}: ${what}. ${load}${planWords(question.plan)}`}
      onYes={() => question.answer(true)}
      onNo={() => question.answer(false)}
    />
  );
}
