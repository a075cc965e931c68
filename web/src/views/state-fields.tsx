// The fields of a state: of the request, or of one passage of a motion.

import type { JSX } from "preact";

import { type CellDocument, geometryOf } from "../model/cell";
import { toolPose } from "../model/chain";
import { currentPositions } from "../state/actions";
import { type StateDraft, toolAt } from "../state/state-draft";
import { cellState, model } from "../state/store";
import { NumberField, SelectField, VectorField } from "./fields";

export const XYZ = ["x", "y", "z"] as const;
export const JOINT_NAMES = ["base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3"] as const;

/** What changes a state; of what is in the world, the request's frame, too. */
export type StateEdit = Partial<StateDraft> & { readonly frame?: "world" };

interface StateProps {
  readonly draft: StateDraft;
  readonly path: string; // of the state in the request
  readonly edit: (fields: StateEdit) => void;
}

/** The fields of a state's kind. */
export function StateFields(props: StateProps): JSX.Element {
  const { kind } = props.draft;
  if (kind === "target") return <TargetFields {...props} />;
  return kind === "joint" ? <JointFields {...props} /> : <ToolFields {...props} />;
}

function TargetFields({ draft, path, edit }: StateProps): JSX.Element {
  return (
    <>
      <VectorField legend="Target" unit="m" path={`${path}.position`} names={XYZ} values={draft.target} onInput={(target) => edit({ target })} />
      <label class="check">
        <input type="checkbox" checked={draft.bin} onChange={(event) => edit({ bin: event.currentTarget.checked })} />
        <span>A round bin stands there</span>
      </label>
      {draft.bin ? (
        <div class="numbers of-2">
          <NumberField label="Radius" unit="m" path={`${path}.opening.radius_m`} value={draft.binRadius} onInput={(binRadius) => edit({ binRadius })} />
          <NumberField label="Rim height" unit="m" path={`${path}.opening.rim_height_m`} value={draft.binRim} onInput={(binRim) => edit({ binRim })} />
        </div>
      ) : null}
      <label class="check">
        <input type="checkbox" checked={draft.moves} onChange={(event) => edit({ moves: event.currentTarget.checked })} />
        <span>It moves</span>
      </label>
      {draft.moves ? (
        <>
          <VectorField legend="Its velocity" unit="m/s" path={`${path}.velocity`} names={["x", "y"]} values={draft.targetVelocity} onInput={(targetVelocity) => edit({ targetVelocity })} />
          <NumberField label="Seen there at" unit="s" path={`${path}.observed_at_s`} placeholder="now" value={draft.observedAt} onInput={(observedAt) => edit({ observedAt })} />
        </>
      ) : null}
    </>
  );
}

function ToolFields({ draft, path, edit }: StateProps): JSX.Element {
  return (
    <>
      <VectorField legend="Tool at the release" unit="m" path={`${path}.${draft.kind === "point" ? "position" : "pose.position"}`} names={XYZ} values={draft.position} onInput={(position) => edit({ position })}>
        <FromHere onPositions={(q) => model.value && edit(toolAt(draft, toolPose(geometryOf(model.value as CellDocument).chain, q.map(Number))))} />
      </VectorField>
      <VectorField legend="Its velocity" unit="m/s" path={`${path}.${draft.kind === "point" ? "velocity" : "twist.linear"}`} names={XYZ} values={draft.velocity} onInput={(velocity) => edit({ velocity })} />
      {draft.kind === "pose" ? <PoseFields draft={draft} path={path} edit={edit} /> : null}
    </>
  );
}

function PoseFields({ draft, path, edit }: StateProps): JSX.Element {
  return (
    <>
      <SelectField
        label="Orientation as"
        options={[["rotation_vector", "rotation vector"], ["quaternion", "quaternion"]]}
        value={draft.orientation}
        onChoose={(orientation) => edit({ orientation })}
      />
      {draft.orientation === "quaternion" ? (
        <VectorField legend="Quaternion" unit="–" path={`${path}.pose.quaternion`} names={["x", "y", "z", "w"]} values={draft.quaternion} onInput={(quaternion) => edit({ quaternion })} />
      ) : (
        <VectorField legend="Rotation vector" unit="rad" path={`${path}.pose.rotation_vector`} names={XYZ} values={draft.rotationVector} onInput={(rotationVector) => edit({ rotationVector })} />
      )}
      <VectorField
        legend="Angular velocity" unit="rad/s" path={`${path}.twist.angular`} names={XYZ} values={draft.angularVelocity}
        onInput={(angularVelocity) => edit({ angularVelocity })}
      />
    </>
  );
}

/** Fills fields with the robot's present state. */
export function FromHere({ onPositions }: { onPositions: (values: readonly string[]) => void }): JSX.Element {
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

function JointFields({ draft, path, edit }: StateProps): JSX.Element {
  return (
    <>
      <VectorField
        legend="Joint positions" unit="rad" path={`${path}.positions`} names={JOINT_NAMES} values={draft.jointPositions}
        onInput={(jointPositions) => edit({ jointPositions })}
      >
        <FromHere onPositions={(jointPositions) => edit({ jointPositions })} />
      </VectorField>
      <VectorField
        legend="Joint velocities" unit="rad/s" path={`${path}.velocities`} names={JOINT_NAMES} values={draft.jointVelocities}
        onInput={(jointVelocities) => edit({ jointVelocities })}
      />
    </>
  );
}

export function TargetOptions({ draft, path, edit }: StateProps): JSX.Element {
  return (
    <>
      <div class="numbers of-2">
        <NumberField label="Speed at most" unit="m/s" path={`${path}.max_release_speed_m_s`} value={draft.maxSpeed} placeholder="free" onInput={(maxSpeed) => edit({ maxSpeed })} />
        <NumberField label="Distance at least" unit="m" path={`${path}.min_horizontal_distance_m`} value={draft.minDistance} placeholder="free" onInput={(minDistance) => edit({ minDistance })} />
        <NumberField label="Elevation from" unit="rad" path={`${path}.min_elevation_rad`} value={draft.minElevation} placeholder="free" onInput={(minElevation) => edit({ minElevation })} />
        <NumberField label="to" unit="rad" path={`${path}.max_elevation_rad`} value={draft.maxElevation} placeholder="free" onInput={(maxElevation) => edit({ maxElevation })} />
      </div>
      <VectorField
        legend="Release position" unit="m" path={`${path}.release_position`} names={XYZ} values={draft.releasePosition} placeholder="free"
        onInput={(releasePosition) => edit({ releasePosition })}
      />
    </>
  );
}
