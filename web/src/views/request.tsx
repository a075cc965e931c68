// The request: what is to be thrown where. Every edit makes the plan on the screen stale.

import type { JSX } from "preact";

import { type CellDocument, geometryOf } from "../model/cell";
import { toolPose } from "../model/chain";
import { currentPositions, edit } from "../state/actions";
import { BACKENDS, type Draft, type Kind, toolAt } from "../state/draft";
import { cellState, draft, dryRun, mode, model } from "../state/store";
import { Choice, NumberField, SelectField, VectorField } from "./fields";

const XYZ = ["x", "y", "z"] as const;
const JOINT_NAMES = ["base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3"] as const;
const KINDS: readonly (readonly [Kind, string])[] = [
  ["target", "Target"],
  ["point", "Point"],
  ["pose", "Pose"],
  ["joint", "Joints"],
];
const KIND_WORDS: Readonly<Record<Kind, string>> = {
  target: "Hit a point; the release is chosen for you.",
  point: "Pass a point with a velocity; the tool's orientation is free.",
  pose: "Pass a tool pose with a twist.",
  joint: "Pass joint positions with joint velocities.",
};

export function RequestFields(): JSX.Element {
  const asked = draft.value;
  return (
    <>
      <Choice legend="What is asked for" name="kind" options={KINDS} value={asked.kind} onChoose={(kind) => edit({ kind })} />
      <p class="hint">{KIND_WORDS[asked.kind]}</p>
      {asked.kind === "target" ? <TargetFields draft={asked} /> : null}
      {asked.kind === "point" || asked.kind === "pose" ? <ToolFields draft={asked} /> : null}
      {asked.kind === "joint" ? <JointFields draft={asked} /> : null}
      <Options draft={asked} />
    </>
  );
}

function TargetFields({ draft }: { draft: Draft }): JSX.Element {
  return (
    <>
      <VectorField legend="Target" unit="m" path="release.position" names={XYZ} values={draft.target} onInput={(target) => edit({ target })} />
      <label class="check">
        <input type="checkbox" checked={draft.bin} onChange={(event) => edit({ bin: event.currentTarget.checked })} />
        <span>A round bin stands there</span>
      </label>
      {draft.bin ? (
        <div class="numbers of-2">
          <NumberField label="Radius" unit="m" path="release.opening.radius_m" value={draft.binRadius} onInput={(binRadius) => edit({ binRadius })} />
          <NumberField label="Rim height" unit="m" path="release.opening.rim_height_m" value={draft.binRim} onInput={(binRim) => edit({ binRim })} />
        </div>
      ) : null}
      <label class="check">
        <input type="checkbox" checked={draft.moves} onChange={(event) => edit({ moves: event.currentTarget.checked })} />
        <span>It moves</span>
      </label>
      {draft.moves ? (
        <>
          <VectorField legend="Its velocity" unit="m/s" path="release.velocity" names={["x", "y"]} values={draft.targetVelocity} onInput={(targetVelocity) => edit({ targetVelocity })} />
          <div class="numbers of-2">
            <NumberField label="Seen there at" unit="s" path="release.observed_at_s" placeholder="now" value={draft.observedAt} onInput={(observedAt) => edit({ observedAt })} />
            <NumberField label="Starts after" unit="s" path="starts_not_before_s" value={draft.startsAfter} onInput={(startsAfter) => edit({ startsAfter })} />
          </div>
        </>
      ) : null}
    </>
  );
}

function ToolFields({ draft }: { draft: Draft }): JSX.Element {
  return (
    <>
      <VectorField legend="Tool at the release" unit="m" path={draft.kind === "point" ? "release.position" : "release.pose.position"} names={XYZ} values={draft.position} onInput={(position) => edit({ position })}>
        <FromHere onPositions={(q) => model.value && edit(toolAt(draft, toolPose(geometryOf(model.value as CellDocument).chain, q.map(Number))))} />
      </VectorField>
      <VectorField legend="Its velocity" unit="m/s" path={draft.kind === "point" ? "release.velocity" : "release.twist.linear"} names={XYZ} values={draft.velocity} onInput={(velocity) => edit({ velocity })} />
      {draft.kind === "pose" ? <PoseFields draft={draft} /> : null}
    </>
  );
}

function PoseFields({ draft }: { draft: Draft }): JSX.Element {
  return (
    <>
      <SelectField
        label="Orientation as"
        options={[["rotation_vector", "rotation vector"], ["quaternion", "quaternion"]]}
        value={draft.orientation}
        onChoose={(orientation) => edit({ orientation })}
      />
      {draft.orientation === "quaternion" ? (
        <VectorField legend="Quaternion" unit="–" path="release.pose.quaternion" names={["x", "y", "z", "w"]} values={draft.quaternion} onInput={(quaternion) => edit({ quaternion })} />
      ) : (
        <VectorField legend="Rotation vector" unit="rad" path="release.pose.rotation_vector" names={XYZ} values={draft.rotationVector} onInput={(rotationVector) => edit({ rotationVector })} />
      )}
      <VectorField
        legend="Angular velocity" unit="rad/s" path="release.twist.angular" names={XYZ} values={draft.angularVelocity}
        onInput={(angularVelocity) => edit({ angularVelocity })}
      />
    </>
  );
}

/** Fills fields with the robot's present state. */
function FromHere({ onPositions }: { onPositions: (values: readonly string[]) => void }): JSX.Element {
  const reported = cellState.value?.executor?.alive === true;
  const take = async (): Promise<void> => {
    const positions = await currentPositions();
    if (positions) onPositions(positions.map((q) => String(Number(q.toFixed(4)))));
  };
  return (
    <button type="button" class="link" disabled={!reported} onClick={() => void take()}>
      from here
    </button>
  );
}

function JointFields({ draft }: { draft: Draft }): JSX.Element {
  return (
    <>
      <VectorField
        legend="Joint positions" unit="rad" path="release.positions" names={JOINT_NAMES} values={draft.jointPositions}
        onInput={(jointPositions) => edit({ jointPositions })}
      >
        <FromHere onPositions={(jointPositions) => edit({ jointPositions })} />
      </VectorField>
      <VectorField
        legend="Joint velocities" unit="rad/s" path="release.velocities" names={JOINT_NAMES} values={draft.jointVelocities}
        onInput={(jointVelocities) => edit({ jointVelocities })}
      />
    </>
  );
}

function Options({ draft }: { draft: Draft }): JSX.Element {
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
      {draft.kind === "target" ? <TargetOptions draft={draft} /> : null}
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

function TargetOptions({ draft }: { draft: Draft }): JSX.Element {
  return (
    <>
      <div class="numbers of-2">
        <NumberField label="Speed at most" unit="m/s" path="release.max_release_speed_m_s" value={draft.maxSpeed} placeholder="free" onInput={(maxSpeed) => edit({ maxSpeed })} />
        <NumberField label="Distance at least" unit="m" path="release.min_horizontal_distance_m" value={draft.minDistance} placeholder="free" onInput={(minDistance) => edit({ minDistance })} />
        <NumberField label="Elevation from" unit="rad" path="release.min_elevation_rad" value={draft.minElevation} placeholder="free" onInput={(minElevation) => edit({ minElevation })} />
        <NumberField label="to" unit="rad" path="release.max_elevation_rad" value={draft.maxElevation} placeholder="free" onInput={(maxElevation) => edit({ maxElevation })} />
        <NumberField label="Hit probability" path="min_hit_probability" value={draft.hitProbability} placeholder="any" onInput={(hitProbability) => edit({ hitProbability })} />
      </div>
      <VectorField
        legend="Release position" unit="m" path="release.release_position" names={XYZ} values={draft.releasePosition} placeholder="free"
        onInput={(releasePosition) => edit({ releasePosition })}
      />
    </>
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
