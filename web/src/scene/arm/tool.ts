/**
 * The tool as its capsules describe it, with two fingers about the object where they can reach it.
 *
 * A cell file knows no more of a gripper than capsules and the tool centre point; the picture adds nothing that could be
 * mistaken for a clearance: the fingers stay within the capsules as long as the object does.
 */

import type { Capsule } from "../../model/cell";
import { norm, plus, type Vector } from "../../model/poses";
import type { ProfilePoint, Turned } from "./turned";

const PLATE_M = 0.008; // [m] adapter between flange and tool
const BODY = 0.8; // visible radius of the tool's body, as a share of its capsule's
const FINGER_M = 0.007; // [m] half the thickness of a finger
export const OPEN_M = 0.012; // [m] way of each finger when the gripper opens

/** The gripper's fingers in the frame of the flange: a box each, beside the object. */
export interface Fingers {
  readonly root: Vector; // where they leave the body, on its axis
  readonly axis: Vector; // from the root towards the object
  readonly length: number;
  readonly aside: number; // of a finger's middle from the axis while the object is held
}

/** Returns the bodies of a tool from its capsules, shortened where fingers begin. */
export function toolParts(capsules: readonly Capsule[], fingers: Fingers | null): Turned[] {
  return capsules.map((capsule, i) => body(capsule, i === capsules.length - 1 ? fingers : null));
}

/** Returns the fingers that reach the object, null where the tool's last capsule does not point at it. */
export function fingersOf(capsules: readonly Capsule[], tcp: Vector, objectRadius: number): Fingers | null {
  const last = capsules.at(-1);
  if (!last) return null;
  const length = norm(plus(last.to, last.from, -1));
  if (length < 1e-6) return null;
  const axis = scaled(plus(last.to, last.from, -1), 1 / length);
  const reach = dot(plus(tcp, last.from, -1), axis);
  const beside = norm(plus(plus(tcp, last.from, -1), axis, -reach));
  if (beside > 0.3 * last.radius || reach < 3 * objectRadius) return null;
  const start = Math.max(0.4 * reach, Math.min(reach - 2.2 * objectRadius - 0.03, length));
  return { root: plus(last.from, axis, start), axis, length: reach + 0.5 * objectRadius - start, aside: objectRadius + FINGER_M };
}

/** Returns the faces of one finger; `side` is the unit vector from the axis to it. */
export function fingerFaces(fingers: Fingers, side: Vector, wide: Vector): Vector[][] {
  const middle = scaled(side, fingers.aside);
  const corner = (i: number, j: number, k: number): Vector => {
    const taper = k ? 0.8 : 1.25;
    const at = plus(plus(middle, side, i * FINGER_M * taper), wide, j * 1.5 * FINGER_M * taper);
    return plus(plus(fingers.root, at), fingers.axis, k * fingers.length);
  };
  const face = (...corners: readonly (readonly [number, number, number])[]): Vector[] => corners.map((c) => corner(...c));
  return [
    face([-1, -1, 0], [1, -1, 0], [1, -1, 1], [-1, -1, 1]),
    face([1, 1, 0], [-1, 1, 0], [-1, 1, 1], [1, 1, 1]),
    face([1, -1, 0], [1, 1, 0], [1, 1, 1], [1, -1, 1]),
    face([-1, 1, 0], [-1, -1, 0], [-1, -1, 1], [-1, 1, 1]),
    face([-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]),
  ];
}

function body(capsule: Capsule, fingers: Fingers | null): Turned {
  const along = plus(capsule.to, capsule.from, -1);
  const length = norm(along);
  const axis: Vector = length > 1e-6 ? scaled(along, 1 / length) : [0, 0, 1];
  const r = BODY * capsule.radius;
  const end = fingers ? dot(plus(fingers.root, capsule.from, -1), axis) + 0.12 * r : length + 0.6 * r;
  const plate = Math.min(PLATE_M, 0.2 * end);
  const profile: ProfilePoint[] = [
    [0, 0],
    [0.86 * r, 0],
    [0.86 * r, plate],
    [r, plate],
    [r, end - 0.3 * r],
    [0.94 * r, end - 0.12 * r],
    [0.8 * r, end],
    [0, end],
  ];
  return { link: capsule.frame, name: capsule.name, origin: capsule.from, axis, colour: "tool", profile };
}

function scaled([x, y, z]: Vector, s: number): Vector {
  return [s * x, s * y, s * z];
}

function dot(a: Vector, b: Vector): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
