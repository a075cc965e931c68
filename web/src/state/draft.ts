// The request as the form holds it: text as typed, so that half a number stays on the screen; and its translation to
// the service's request and back.

import { type Pose, positionOf, quaternionOfPose, rotationVectorOf } from "../model/poses";
import type { Nearest, PlanRequest } from "../service/types";

export type Kind = "target" | "point" | "pose" | "joint";
type Backend = NonNullable<PlanRequest["backend"]>;
export const BACKENDS: readonly Backend[] = ["auto", "casadi", "ruckig", "toppra", "cubic", "trapezoid", "ramp"];

/** Everything that a person can ask for. Empty text: the service's default. */
export interface Draft {
  readonly kind: Kind;
  readonly frame: "world" | "base";
  readonly target: readonly string[]; // (3) [m]
  readonly bin: boolean;
  readonly binRadius: string; // [m]
  readonly binRim: string; // [m]
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
  readonly start: "home" | "current" | "positions";
  readonly startPositions: readonly string[]; // (6) [rad]
  readonly backend: Backend;
  readonly velocityLimit: string; // one number or six [rad/s]
  readonly accelerationLimit: string;
  readonly jerkLimit: string;
  readonly singularityDistance: string;
  readonly window: string; // [s]
  readonly tolerance: string; // [m]
  readonly hitProbability: string;
  readonly timeLimit: string; // [s]
}

const NONE3 = ["", "", ""] as const;

export const FIRST_DRAFT: Draft = {
  kind: "target",
  frame: "world",
  target: ["1.2", "0.3", "0"],
  bin: false,
  binRadius: "0.12",
  binRim: "0.2",
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
  start: "home",
  startPositions: ["0", "-1.57", "1.57", "-1.57", "-1.57", "0"],
  backend: "auto",
  velocityLimit: "",
  accelerationLimit: "",
  jerkLimit: "",
  singularityDistance: "",
  window: "",
  tolerance: "",
  hitProbability: "",
  timeLimit: "",
};

/** Text that is no number, by the name of its field in the form and its path in the request. */
export class InvalidDraft extends Error {
  constructor(
    readonly field: string,
    readonly text: string,
    readonly path = "",
  ) {
    super(`${field}: ${faultOf(text)}`);
  }
}

/** What is wrong with a text that is no number. */
function faultOf(text: string): string {
  return text.trim() === "" ? "a number is needed" : `${JSON.stringify(text)} is not a number`;
}

/** Whether a text reads as a number, or as none yet. */
export function isNumber(text: string): boolean {
  return Number.isFinite(Number(text.trim().replace(",", ".")));
}

export function numberOf(text: string, field: string, path = ""): number {
  if (text.trim() === "" || !isNumber(text)) throw new InvalidDraft(field, text, path);
  return Number(text.trim().replace(",", "."));
}

export function numbersOf(texts: readonly string[], field: string, path = ""): number[] {
  return texts.map((text, i) => numberOf(text, `${field} ${i + 1}`, `${path}[${i}]`));
}

function optional(text: string, field: string, path: string): number | undefined {
  return text.trim() === "" ? undefined : numberOf(text, field, path);
}

/** One number for all joints, or six separated by spaces or commas. */
function perJoint(text: string, field: string, path: string): number | number[] | undefined {
  const parts = text.trim().split(/[\s,;]+/).filter(Boolean);
  if (parts.length === 0) return undefined;
  const values = parts.map((part) => numberOf(part, field, path));
  if (values.length === 1) return values[0];
  if (values.length !== 6) throw new InvalidDraft(field, text, path);
  return values;
}

function defined<T extends object>(fields: T): T {
  return Object.fromEntries(Object.entries(fields).filter(([, value]) => value !== undefined)) as T;
}

function releaseOf(draft: Draft): PlanRequest["release"] {
  if (draft.kind === "target") return targetOf(draft);
  if (draft.kind === "joint") {
    return {
      kind: "joint",
      positions: numbersOf(draft.jointPositions, "joint position", "release.positions"),
      velocities: numbersOf(draft.jointVelocities, "joint velocity", "release.velocities"),
    };
  }
  const free = draft.kind === "point";
  const position = numbersOf(draft.position, "position", free ? "release.position" : "release.pose.position");
  const velocity = numbersOf(draft.velocity, "velocity", free ? "release.velocity" : "release.twist.linear");
  if (draft.kind === "point") return { kind: "point", position, velocity };
  const orientation =
    draft.orientation === "quaternion"
      ? { quaternion: numbersOf(draft.quaternion, "quaternion", "release.pose.quaternion") }
      : { rotation_vector: numbersOf(draft.rotationVector, "rotation vector", "release.pose.rotation_vector") };
  const angular = numbersOf(draft.angularVelocity, "angular velocity", "release.twist.angular");
  return { kind: "pose", pose: { position, ...orientation }, twist: { linear: velocity, angular } };
}

function targetOf(draft: Draft): PlanRequest["release"] {
  const from = draft.releasePosition.every((text) => text.trim() === "") ? undefined : draft.releasePosition;
  return defined({
    kind: "target" as const,
    position: numbersOf(draft.target, "target", "release.position"),
    opening: draft.bin
      ? { radius_m: numberOf(draft.binRadius, "bin radius", "release.opening.radius_m"), rim_height_m: numberOf(draft.binRim, "bin rim", "release.opening.rim_height_m") }
      : undefined,
    max_release_speed_m_s: optional(draft.maxSpeed, "largest release speed", "release.max_release_speed_m_s"),
    min_elevation_rad: optional(draft.minElevation, "least elevation", "release.min_elevation_rad"),
    max_elevation_rad: optional(draft.maxElevation, "largest elevation", "release.max_elevation_rad"),
    min_horizontal_distance_m: optional(draft.minDistance, "least distance", "release.min_horizontal_distance_m"),
    release_position: from === undefined ? undefined : numbersOf(from, "release position", "release.release_position"),
  }) as PlanRequest["release"];
}

/** Returns the request for `POST /plan`. Throws InvalidDraft for text that is no number. */
export function requestOf(draft: Draft, cell: string): PlanRequest {
  const limits = defined({
    velocity: perJoint(draft.velocityLimit, "velocity limit", "limits.velocity"),
    acceleration: perJoint(draft.accelerationLimit, "acceleration limit", "limits.acceleration"),
    jerk: perJoint(draft.jerkLimit, "jerk limit", "limits.jerk"),
  });
  return defined({
    cell,
    start: startOf(draft),
    release: releaseOf(draft),
    frame: draft.frame,
    backend: draft.backend,
    limits: Object.keys(limits).length > 0 ? limits : undefined,
    singularity_distance_min: optional(draft.singularityDistance, "singularity distance", "singularity_distance_min"),
    release_window_s: optional(draft.window, "release window", "release_window_s"),
    landing_tolerance_m: optional(draft.tolerance, "landing tolerance", "landing_tolerance_m"),
    min_hit_probability: optional(draft.hitProbability, "hit probability", "min_hit_probability"),
    time_limit_s: optional(draft.timeLimit, "time limit", "time_limit_s"),
  }) as PlanRequest;
}

function startOf(draft: Draft): PlanRequest["start"] | undefined {
  if (draft.start === "current") return { current: true };
  if (draft.start === "positions") return { positions: numbersOf(draft.startPositions, "start position", "start.positions") };
  return undefined;
}

/** Returns the request of a preview while dragging: the fast back end, for a release on time alone. */
export function previewOf(draft: Draft, cell: string): PlanRequest {
  const { min_hit_probability: _, ...request } = requestOf(draft, cell) as PlanRequest & { min_hit_probability?: number };
  return { ...request, backend: "ruckig", release_window_s: 0, landing_tolerance_m: 0 };
}

const texts = (values: readonly number[]): string[] => values.map(String);
const text = (value: number | null | undefined, before: string): string =>
  value === null || value === undefined || before === "" ? before : String(value);

/** Returns the draft that asks for what the service offers instead: its release, exactly, and its window. */
export function withNearest(draft: Draft, nearest: Nearest): Draft {
  const release = nearest.release;
  const common = {
    ...draft,
    frame: nearest.frame ?? draft.frame,
    window: nearest.release_window_s === undefined || nearest.release_window_s === null ? draft.window : String(nearest.release_window_s),
    tolerance: nearest.landing_tolerance_m === undefined || nearest.landing_tolerance_m === null ? draft.tolerance : String(nearest.landing_tolerance_m),
    singularityDistance: text(nearest.singularity_distance_min, draft.singularityDistance),
  };
  if (!release) return common;
  if (release.kind === "joint") {
    return { ...common, kind: "joint", jointPositions: texts(release.positions), jointVelocities: texts(release.velocities) };
  }
  if (release.kind === "point") {
    return { ...common, kind: "point", position: texts(release.position), velocity: texts(release.velocity) };
  }
  if (release.kind === "pose") return { ...common, ...poseTexts(release) };
  return {
    ...common,
    kind: "target",
    target: Array.isArray(release.position) ? texts(release.position) : draft.target,
    maxSpeed: text(release.max_release_speed_m_s, draft.maxSpeed),
    minElevation: text(release.min_elevation_rad, draft.minElevation),
    maxElevation: text(release.max_elevation_rad, draft.maxElevation),
    minDistance: text(release.min_horizontal_distance_m, draft.minDistance),
  };
}

/** Returns the form that asks for what a request asks for; what it has no field for is left out. */
export function draftOf(request: PlanRequest): Draft {
  const number = (value: unknown): string => (value === null || value === undefined ? "" : String(value));
  const joints = (value: number | readonly number[] | null | undefined): string => (Array.isArray(value) ? value.join(" ") : number(value));
  const start = request.start as { current?: boolean; positions?: number[] } | null | undefined;
  const own: Draft = {
    ...FIRST_DRAFT,
    frame: request.frame ?? FIRST_DRAFT.frame,
    backend: request.backend ?? FIRST_DRAFT.backend,
    start: start?.current ? "current" : start?.positions ? "positions" : "home",
    ...(start?.positions ? { startPositions: texts(start.positions) } : {}),
    velocityLimit: joints(request.limits?.velocity),
    accelerationLimit: joints(request.limits?.acceleration),
    jerkLimit: joints(request.limits?.jerk),
    singularityDistance: number(request.singularity_distance_min),
    window: number(request.release_window_s),
    tolerance: number(request.landing_tolerance_m),
    hitProbability: number(request.min_hit_probability),
    timeLimit: number(request.time_limit_s),
  };
  const release = request.release;
  if (release?.kind !== "target") return withNearest(own, request);
  return {
    ...own,
    kind: "target",
    target: Array.isArray(release.position) ? texts(release.position) : own.target, // plans hold numbers
    bin: Boolean(release.opening),
    ...(release.opening ? { binRadius: String(release.opening.radius_m), binRim: String(release.opening.rim_height_m) } : {}),
    maxSpeed: number(release.max_release_speed_m_s),
    minElevation: number(release.min_elevation_rad),
    maxElevation: number(release.max_elevation_rad),
    minDistance: number(release.min_horizontal_distance_m),
    releasePosition: release.release_position ? texts(release.release_position) : NONE3,
  };
}

function poseTexts(release: Extract<NonNullable<PlanRequest["release"]>, { kind: "pose" }>): Partial<Draft> {
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
export function toolAt(draft: Draft, pose: Pose): Partial<Draft> {
  const place = { frame: "world" as const, position: positionOf(pose).map((x) => x.toFixed(4)) };
  const quaternion = quaternionOfPose(pose);
  if (draft.orientation === "quaternion") return { ...place, quaternion: quaternion.map((x) => x.toFixed(6)) };
  return { ...place, rotationVector: rotationVectorOf(quaternion).map((x) => x.toFixed(4)) };
}

export function vector(values: readonly string[]): [number, number, number] | null {
  const [x, y, z] = values.map((value) => (value.trim() === "" ? NaN : Number(value.replace(",", "."))));
  if (x === undefined || y === undefined || z === undefined) return null;
  return [x, y, z].every(Number.isFinite) ? [x, y, z] : null;
}
