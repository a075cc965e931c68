// The request: what is to be thrown where. Every edit makes the plan on the screen stale.

import type { JSX } from "preact";

import { edit } from "../state/actions";
import { BACKENDS, type Draft } from "../state/draft";
import { newPassage } from "../state/passage-draft";
import type { Kind, StateDraft } from "../state/state-draft";
import { draft, dryRun, mode } from "../state/store";
import { Choice, NumberField, SelectField, VectorField } from "./fields";
import { MotionFields } from "./motion-fields";
import { FromHere, JOINT_NAMES, StateFields, TargetOptions } from "./state-fields";

const KINDS: readonly (readonly [Kind | "motion", string])[] = [
  ["target", "Target"],
  ["point", "Point"],
  ["pose", "Pose"],
  ["joint", "Joints"],
  ["motion", "Motion"],
];
const KIND_WORDS: Readonly<Record<Kind | "motion", string>> = {
  target: "Hit a point; the release is chosen for you.",
  point: "Pass a point with a velocity; the tool's orientation is free.",
  pose: "Pass a tool pose with a twist.",
  joint: "Pass joint positions with joint velocities.",
  motion: "Pass several states and lines, and switch outputs about them.",
};

export function RequestFields(): JSX.Element {
  const asked = draft.value;
  const kind = asked.isMotion ? "motion" : asked.kind;
  const passages = asked.passages.length > 0 ? asked.passages : [newPassage([])];
  return (
    <>
      <Choice
        legend="What is asked for" name="kind" options={KINDS} value={kind}
        onChoose={(chosen) => edit(chosen === "motion" ? { isMotion: true, passages } : { isMotion: false, kind: chosen })}
      />
      <p class="hint">{KIND_WORDS[kind]}</p>
      {asked.isMotion ? <MotionFields draft={asked} /> : <StateFields draft={asked} path="release" edit={edit} />}
      {targetsOf(asked).some(({ moves }) => moves) ? (
        <NumberField label="Starts after it is seen" unit="s" path="starts_not_before_s" value={asked.startsAfter} onInput={(startsAfter) => edit({ startsAfter })} />
      ) : null}
      <Options draft={asked} />
    </>
  );
}

/** Returns the states that throw at a target. */
function targetsOf(draft: Draft): StateDraft[] {
  const states = draft.isMotion ? draft.passages.flatMap(({ isLine, state }) => (isLine ? [] : [state])) : [draft];
  return states.filter(({ kind }) => kind === "target");
}

function Options({ draft }: { draft: Draft }): JSX.Element {
  const hits = targetsOf(draft).length > 0;
  return (
    <details class="options">
      <summary>Options</summary>
      <SelectField
        label="Start"
        options={[["home", "the cell's home"], ["current", "where the robot stands"], ["positions", "joint positions"]]}
        value={draft.start}
        onChoose={(start) => edit({ start })}
      />
      {draft.start === "positions" ? (
        <VectorField
          legend="Start positions" unit="rad" path="start.positions" names={JOINT_NAMES} values={draft.startPositions}
          onInput={(startPositions) => edit({ startPositions })}
        >
          <FromHere onPositions={(startPositions) => edit({ startPositions })} />
        </VectorField>
      ) : null}
      {hits && !draft.isMotion ? <TargetOptions draft={draft} path="release" edit={edit} /> : null}
      {hits ? <NumberField label="Hit probability" path="min_hit_probability" value={draft.hitProbability} placeholder="any" onInput={(hitProbability) => edit({ hitProbability })} /> : null}
      <div class="numbers of-2">
        <NumberField label="Release window ±" unit="s" path="release_window_s" value={draft.window} placeholder="default" onInput={(window) => edit({ window })} />
        <NumberField label="Landing tolerance" unit="m" path="landing_tolerance_m" value={draft.tolerance} placeholder="default" onInput={(tolerance) => edit({ tolerance })} />
      </div>
      <LimitOptions draft={draft} />
      <div class="numbers of-2">
        <SelectField
          label="Frame" options={[["world", "world"], ["base", "base of the arm"]]} value={draft.frame}
          onChoose={(frame) => edit({ frame })}
        />
        <SelectField
          label="Back end" options={BACKENDS.map((name) => [name, name] as const)} value={draft.backend}
          onChoose={(backend) => edit({ backend })}
        />
        <NumberField label="Time limit" unit="s" path="time_limit_s" value={draft.timeLimit} placeholder="120" onInput={(timeLimit) => edit({ timeLimit })} />
        <SelectField
          label="Motion by" options={[["speedj", "speedj"], ["servoj", "servoj"], ["script", "the controller"]]} value={mode.value}
          onChoose={(chosen) => (mode.value = chosen)}
        />
      </div>
      <label class="check">
        <input type="checkbox" checked={dryRun.value} onChange={(event) => (dryRun.value = event.currentTarget.checked)} />
        <span>Dry run: everything but motion</span>
      </label>
    </details>
  );
}

function LimitOptions({ draft }: { draft: Draft }): JSX.Element {
  return (
    <>
      <p class="hint">Limits may only be tighter than the cell's: one number, or six.</p>
      <div class="numbers of-2">
        <NumberField label="Joint velocity" unit="rad/s" path="limits.velocity" several value={draft.velocityLimit} placeholder="the cell's" onInput={(velocityLimit) => edit({ velocityLimit })} />
        <NumberField label="Acceleration" unit="rad/s²" path="limits.acceleration" several value={draft.accelerationLimit} placeholder="the cell's" onInput={(accelerationLimit) => edit({ accelerationLimit })} />
        <NumberField label="Jerk" unit="rad/s³" path="limits.jerk" several value={draft.jerkLimit} placeholder="the cell's" onInput={(jerkLimit) => edit({ jerkLimit })} />
        <NumberField label="Singularity distance" unit="–" path="singularity_distance_min" value={draft.singularityDistance} placeholder="the cell's" onInput={(singularityDistance) => edit({ singularityDistance })} />
      </div>
    </>
  );
}
