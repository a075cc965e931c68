// A state to pass as the form holds it: text as typed; and its translation to the service's request and back.

import { type Pose, positionOf, quaternionOfPose, rotationVectorOf } from "../model/poses";
import type { PlanRequest } from "../service/types";
import { defined, numberOf, numbersOf, optional, rounded, texts, textOf } from "./numbers";

export type Kind = "target" | "point" | "pose" | "joint";
export type Release = NonNullable<PlanRequest["release"]>;

/** Everything that a person can ask of a state. Empty text: the service's default. */
export interface StateDraft {
  readonly kind: Kind;
  readonly target: readonly string[]; // (3) [m]
  readonly bin: boolean;
  readonly binRadius: string; // [m]
  readonly binRim: string; // [m]
  readonly moves: boolean;
  readonly targetVelocity: readonly string[]; // (2) of a target that moves, along x and y [m/s]
  readonly observedAt: string; // when it is at `target`, on the controller's clock [s]; empty: now
  readonly maxSpeed: string; // [m/s]
  readonly minElevation: string; // [rad]
  readonly maxElevation: string; // [rad]
  readonly minDistance: string; // [m]
  readonly releasePosition: readonly string[]; // (3) [m]
  readonly position: readonly string[]; // (3) of the tool at a point or pose release [m]
  readonly orientation: "rotation_vector" | "quaternion";
  readonly rotationVector: readonly string[]; // (3) [rad]
  readonly quaternion: readonly string[]; // (4) x, y, z, w
  readonly velocity: readonly string[]; // (3) [m/s]
  readonly angularVelocity: readonly string[]; // (3) [rad/s]
  readonly jointPositions: readonly string[]; // (6) [rad]
  readonly jointVelocities: readonly string[]; // (6) [rad/s]
}

const NONE3 = ["", "", ""] as const;

export const FIRST_STATE_DRAFT: StateDraft = {
  kind: "target",
  target: ["1.2", "0.3", "0"],
  bin: false,
  binRadius: "0.12",
  binRim: "0.2",
  moves: false,
  targetVelocity: ["0", "0.1"],
  observedAt: "",
  maxSpeed: "",
  minElevation: "",
  maxElevation: "",
  minDistance: "",
  releasePosition: NONE3,
  position: ["0.4", "0.2", "0.5"],
  orientation: "rotation_vector",
  rotationVector: ["0", "1.57", "0"], // the gripper forwards
  quaternion: ["0", "0.70711", "0", "0.70711"],
  velocity: ["0.8", "0.3", "0.6"],
  angularVelocity: ["0", "0", "0"],
  jointPositions: ["0.4", "-1.4", "1.2", "-1.2", "-1.57", "0"],
  jointVelocities: ["0.8", "0.6", "-0.5", "0.3", "0", "0"],
};

/** Returns the state as requests state it; `path` is where, `now_s` the controller's time, null where nobody tells it. */
export function releaseOf(draft: StateDraft, path: string, now_s: number | null): Release {
  if (draft.kind === "target") return targetOf(draft, path, now_s);
  if (draft.kind === "joint") {
    return {
      kind: "joint",
      positions: numbersOf(draft.jointPositions, "joint position", `${path}.positions`),
      velocities: numbersOf(draft.jointVelocities, "joint velocity", `${path}.velocities`),
    };
  }
  const free = draft.kind === "point";
  const position = numbersOf(draft.position, "position", `${path}.${free ? "position" : "pose.position"}`);
  const velocity = numbersOf(draft.velocity, "velocity", `${path}.${free ? "velocity" : "twist.linear"}`);
  if (draft.kind === "point") return { kind: "point", position, velocity };
  const orientation =
    draft.orientation === "quaternion"
      ? { quaternion: numbersOf(draft.quaternion, "quaternion", `${path}.pose.quaternion`) }
      : { rotation_vector: numbersOf(draft.rotationVector, "rotation vector", `${path}.pose.rotation_vector`) };
  const angular = numbersOf(draft.angularVelocity, "angular velocity", `${path}.twist.angular`);
  return { kind: "pose", pose: { position, ...orientation }, twist: { linear: velocity, angular } };
}

/** Returns when a target that moves is where the form says, on the controller's clock [s]; undefined for one that stands. */
export function observedAt(draft: StateDraft, path: string, now_s: number | null): number | undefined {
  if (draft.kind !== "target" || !draft.moves || draft.targetVelocity.every((text) => Number(text) === 0)) return undefined;
  return draft.observedAt.trim() === "" && now_s !== null ? rounded(now_s) : numberOf(draft.observedAt, "seen at", `${path}.observed_at_s`);
}

function targetOf(draft: StateDraft, path: string, now_s: number | null): Release {
  const from = draft.releasePosition.every((text) => text.trim() === "") ? undefined : draft.releasePosition;
  const observed_at_s = observedAt(draft, path, now_s);
  return defined({
    kind: "target" as const,
    position: numbersOf(draft.target, "target", `${path}.position`),
    opening: draft.bin
      ? { radius_m: numberOf(draft.binRadius, "bin radius", `${path}.opening.radius_m`), rim_height_m: numberOf(draft.binRim, "bin rim", `${path}.opening.rim_height_m`) }
      : undefined,
    velocity: observed_at_s === undefined ? undefined : [...numbersOf(draft.targetVelocity, "velocity", `${path}.velocity`), 0],
    observed_at_s,
    max_release_speed_m_s: optional(draft.maxSpeed, "largest release speed", `${path}.max_release_speed_m_s`),
    min_elevation_rad: optional(draft.minElevation, "least elevation", `${path}.min_elevation_rad`),
    max_elevation_rad: optional(draft.maxElevation, "largest elevation", `${path}.max_elevation_rad`),
    min_horizontal_distance_m: optional(draft.minDistance, "least distance", `${path}.min_horizontal_distance_m`),
    release_position: from === undefined ? undefined : numbersOf(from, "release position", `${path}.release_position`),
  }) as Release;
}

/** Returns the state that asks for what a request asks for; what it has no field for is left out. */
export function stateOf(release: Release): StateDraft {
  if (release.kind !== "target") return { ...FIRST_STATE_DRAFT, ...stateTexts(release) };
  const { velocity, observed_at_s } = release;
  return {
    ...FIRST_STATE_DRAFT,
    target: Array.isArray(release.position) ? texts(release.position) : FIRST_STATE_DRAFT.target, // plans hold numbers
    bin: Boolean(release.opening),
    ...(release.opening ? { binRadius: String(release.opening.radius_m), binRim: String(release.opening.rim_height_m) } : {}),
    ...(velocity && typeof observed_at_s === "number"
      ? { moves: velocity.some((v) => v !== 0), targetVelocity: texts(velocity.slice(0, 2)), observedAt: String(observed_at_s) }
      : {}),
    maxSpeed: textOf(release.max_release_speed_m_s),
    minElevation: textOf(release.min_elevation_rad),
    maxElevation: textOf(release.max_elevation_rad),
    minDistance: textOf(release.min_horizontal_distance_m),
    releasePosition: release.release_position ? texts(release.release_position) : NONE3,
  };
}

/** Returns the fields of a state that throws at no target. */
export function stateTexts(release: Exclude<Release, { kind: "target" }>): Partial<StateDraft> {
  if (release.kind === "joint") return { kind: "joint", jointPositions: texts(release.positions), jointVelocities: texts(release.velocities) };
  if (release.kind === "point") return { kind: "point", position: texts(release.position), velocity: texts(release.velocity) };
  const { pose, twist } = release;
  return {
    kind: "pose",
    position: texts(pose.position),
    ...(pose.quaternion ? { orientation: "quaternion" as const, quaternion: texts(pose.quaternion) } : {}),
    ...(pose.rotation_vector && !pose.quaternion
      ? { orientation: "rotation_vector" as const, rotationVector: texts(pose.rotation_vector) }
      : {}),
    velocity: texts(twist.linear),
    angularVelocity: texts(twist.angular),
  };
}

/** Returns what puts the tool of a point or pose release at a pose in the world. */
export function toolAt(draft: StateDraft, pose: Pose): Partial<StateDraft> & { readonly frame: "world" } {
  const place = { frame: "world" as const, position: positionOf(pose).map((x) => x.toFixed(4)) };
  const quaternion = quaternionOfPose(pose);
  if (draft.orientation === "quaternion") return { ...place, quaternion: quaternion.map((x) => x.toFixed(6)) };
  return { ...place, rotationVector: rotationVectorOf(quaternion).map((x) => x.toFixed(4)) };
}
