/**
 * What an arm looks like: turned parts made from the capsules of its cell, in the look of Universal Robots' arms.
 *
 * Every joint has a housing about its axis, closed by a lid, and a dark seal where the next link begins. Lengths are those
 * of the chain, widths those of the capsules that the planner certifies with, less what these are wider than the arm: so
 * nothing is drawn far outside of what it checks (tested).
 */

import type { Capsule, CellGeometry } from "../../model/cell";
import { positionOf, type Vector } from "../../model/poses";
import type { ProfilePoint, Turned } from "./turned";

const Y: Vector = [0, 1, 0];
const Z: Vector = [0, 0, 1];
const SEAL = 0.08; // width of a seal as a share of the housing's radius
const SEAM = 1.04; // where a housing ends towards the next link, in radii from the middle of its tube
const HOUSING = 0.86; // visible radius of a housing, as a share of its capsule's: benchmarks/arm_capsules makes it wider
const ELBOW = 0.83; // of the elbow's
const TUBE = 0.93; // and of a tube
const NECK = 0.8; // radius of what enters a housing from the side, as a share of the housing's
const LID = 0.82; // where a lid begins, in radii beyond the middle of the tube: past the neck
const FLANGE_M = 0.006; // [m] the tool flange's step

/** Dimensions of an arm [m], read off its chain and capsules. */
interface Dimensions {
  readonly foot: number;
  readonly shoulder: number;
  readonly upperTube: number;
  readonly elbow: number;
  readonly foreTube: number;
  readonly wrist: number;
  readonly upperLength: number;
  readonly foreLength: number;
  readonly upperOffset: number;
  readonly foreOffset: number;
  readonly d1: number;
  readonly d4: number;
  readonly d5: number;
  readonly d6: number;
}

/** Returns the parts of a cell's arm. */
export function armParts(cell: Pick<CellGeometry, "chain" | "capsules">): Turned[] {
  const dimensions = dimensionsOf(cell);
  return [
    ...baseParts(dimensions),
    ...shoulderParts(dimensions),
    ...upperArmParts(dimensions),
    ...forearmParts(dimensions),
    ...wristParts(dimensions),
  ];
}

function dimensionsOf({ chain, capsules }: Pick<CellGeometry, "chain" | "capsules">): Dimensions {
  const capsule = (name: string): Capsule => {
    const found = capsules.find((item) => item.name === name);
    if (!found) throw new Error(`the cell's model has no capsule ${name}`);
    return found;
  };
  const [upper, fore] = [capsule("upper_arm"), capsule("forearm")];
  const steps = chain.transforms.map(positionOf); // from joint to joint: a, 0, d of the Denavit-Hartenberg table
  const [d1, d4, d5, d6] = [0, 3, 4, 5].map((joint) => steps[joint]![2]) as [number, number, number, number];
  return {
    foot: capsule("foot").radius,
    shoulder: HOUSING * capsule("base").radius,
    upperTube: TUBE * upper.radius,
    elbow: ELBOW * capsule("elbow").radius,
    foreTube: TUBE * fore.radius,
    wrist: HOUSING * capsule("wrist_1").radius,
    upperLength: -steps[1]![0],
    foreLength: -steps[2]![0],
    upperOffset: upper.from[2],
    foreOffset: fore.from[2],
    d1,
    d4,
    d5,
    d6,
  };
}

/** Returns the end of a housing: a groove and a domed lid, `base` radii beyond the middle of its tube. */
function lidParts(link: number, name: string, origin: Vector, axis: Vector, R: number, middle: number): Turned[] {
  const at = (radius: number, beyond: number): ProfilePoint => [radius * R, middle + (LID + beyond) * R];
  const dome = [at(0.92, 0), at(0.92, 0.07), at(0.89, 0.14), at(0.82, 0.19), at(0.7, 0.225), at(0.4, 0.26), at(0, 0.27)];
  return [
    { link, name: `${name}_groove`, origin, axis, colour: "seal", profile: [at(0.93, -0.06), at(0.93, 0.02), at(0.5, 0.02)] },
    { link, name: `${name}_lid`, origin, axis, colour: "lid", profile: dome },
  ];
}

/** Returns a housing about an axis from its seam to its lid; `middle` is where its tube crosses it. */
function housing(link: number, name: string, origin: Vector, axis: Vector, R: number, seam: number, middle = 0): Turned[] {
  const at = (radius: number, beyond: number): ProfilePoint => [radius * R, middle + (LID + beyond) * R];
  const shell: ProfilePoint[] = [
    [0.9 * R, seam],
    [0.97 * R, seam],
    [R, seam + 0.05 * R],
    at(1, -0.17),
    at(0.985, -0.08),
    at(0.95, -0.02),
    at(0.9, -0.02),
  ];
  return [{ link, name, origin, axis, colour: "shell", profile: shell }, ...lidParts(link, name, origin, axis, R, middle)];
}

/** Returns the dark ring between two links. */
function seal(link: number, origin: Vector, axis: Vector, R: number, along: number): Turned {
  const [low, high] = [along - SEAL * R, along + SEAL * R];
  const profile: ProfilePoint[] = [[0, low], [0.93 * R, low], [0.93 * R, high], [0, high]];
  return { link, name: "seal", origin, axis, colour: "seal", profile };
}

/** Returns a tube between two housings of radii `R`, with a collar at each; it stays below their lids. */
function tube(link: number, name: string, origin: Vector, axis: Vector, length: number, r: number, R: readonly [number, number]): Turned[] {
  const [wide, wideEnd] = R.map((radius) => Math.min(NECK * radius, 1.12 * r)) as [number, number];
  const [first, last] = [R[0] + 0.1 * r, length - R[1] - 0.1 * r];
  const profile: ProfilePoint[] = [
    [wide, 0.2 * R[0]],
    [wide, first],
    [0.97 * wide, first + 0.1 * r],
    [r, first + 0.24 * r],
    [r, last - 0.24 * r],
    [0.97 * wideEnd, last - 0.1 * r],
    [wideEnd, last],
    [wideEnd, length - 0.2 * R[1]],
  ];
  return [{ link, name, origin, axis, colour: "tube", profile }];
}

/** Returns a neck of some length that ends inside a housing: a flange at the seam, then thinner. */
function neck(R: number, length: number): ProfilePoint[] {
  const flange = Math.min(0.28 * R, length - 0.92 * R);
  const thin: ProfilePoint[] = [[NECK * R, 0], ...dome(NECK * R, 0, 0.9)];
  if (flange < 0.08 * R) return [[0.5 * R, -length], [NECK * R, -length], ...thin];
  return [
    [0.5 * R, -length],
    [0.97 * R, -length],
    [R, -length + 0.05 * R],
    [R, -length + flange - 0.04 * R],
    [0.97 * R, -length + flange],
    [NECK * R, -length + flange + 0.08 * R],
    ...thin,
  ];
}

function baseParts({ foot, shoulder: R, d1 }: Dimensions): Turned[] {
  const top = Math.max(d1 - SEAM * R, 0.028);
  const plate: ProfilePoint[] = [[0, 0], [foot, 0], [foot, 0.012], [0.97 * foot, 0.016], [0, 0.016]];
  const shell: ProfilePoint[] = [
    [0.985 * R, 0.014],
    [1.0 * R, 0.02],
    [R, top - 0.06 * R],
    [0.97 * R, top - 0.01 * R],
    [0.5 * R, top],
  ];
  return [
    { link: 0, name: "foot", origin: [0, 0, 0], axis: Z, colour: "metal", profile: plate },
    { link: 0, name: "base", origin: [0, 0, 0], axis: Z, colour: "shell", profile: shell },
    seal(0, [0, 0, top], Z, R, 0.04 * R),
  ];
}

function shoulderParts({ shoulder: R, upperOffset, d1 }: Dimensions): Turned[] {
  const bottom = Math.max(d1 - SEAM * R, 0.028) - d1 + 0.1 * R;
  const upright: ProfilePoint[] = [[0.5 * R, bottom], [0.97 * R, bottom], [R, bottom + 0.05 * R], [R, 0], ...dome(R, 0, 1)];
  const end = upperOffset - SEAM * R;
  const across: ProfilePoint[] = [[R, 0], [R, end - 0.05 * R], [0.97 * R, end], [0.9 * R, end]];
  return [
    { link: 1, name: "shoulder_neck", origin: [0, 0, 0], axis: Y, colour: "shell", profile: upright },
    { link: 1, name: "shoulder", origin: [0, 0, 0], axis: Z, colour: "shell", profile: across },
    seal(1, [0, 0, 0], Z, R, end + 0.04 * R),
  ];
}

/** Returns the rest of a profile that ends in a dome of radius R, flattened by `height`. */
function dome(R: number, along: number, height: number): ProfilePoint[] {
  return [15, 30, 45, 60, 75, 90].map((degrees) => {
    const angle = (degrees * Math.PI) / 180;
    return [R * Math.cos(angle), along + height * R * Math.sin(angle)] as ProfilePoint;
  });
}

function upperArmParts({ shoulder, elbow, upperTube, upperLength, upperOffset, foreOffset }: Dimensions): Turned[] {
  const start: Vector = [upperLength, 0, upperOffset];
  const seam = Math.max(-SEAM * elbow, -(upperOffset - foreOffset) / 2);
  return [
    ...housing(2, "upper_arm_start", start, Z, shoulder, -(SEAM - 0.08) * shoulder),
    ...tube(2, "upper_arm", start, [-1, 0, 0], upperLength, upperTube, [shoulder, elbow]),
    ...housing(2, "elbow", [0, 0, upperOffset], Z, elbow, seam),
    seal(2, [0, 0, upperOffset], Z, elbow, seam - 0.04 * elbow),
  ];
}

function forearmParts({ elbow, foreTube, wrist, foreLength, upperOffset, foreOffset }: Dimensions): Turned[] {
  const seam = Math.max(-SEAM * elbow, -(upperOffset - foreOffset) / 2);
  const start: Vector = [foreLength, 0, foreOffset];
  const top = upperOffset - foreOffset + seam - 0.08 * elbow; // of the elbow's second half, above the forearm
  const down: Vector = [0, 0, -1];
  const half: ProfilePoint[] = [[0.9 * elbow, -top], [0.97 * elbow, -top], [elbow, -top + 0.05 * elbow]];
  const bottom = -(elbow - foreTube) + 0.05 * elbow;
  return [
    { link: 3, name: "forearm_start", origin: start, axis: down, colour: "shell", profile: [...half, [elbow, bottom], ...dome(elbow, bottom, 0.93)] },
    ...tube(3, "forearm", start, [-1, 0, 0], foreLength, foreTube, [elbow, wrist]),
    ...housing(3, "wrist_1", [0, 0, foreOffset], down, wrist, -SEAM * wrist),
    seal(3, [0, 0, foreOffset], Z, wrist, (SEAM + 0.04) * wrist),
  ];
}

function wristParts({ wrist: R, foreOffset, d4, d5, d6 }: Dimensions): Turned[] {
  const [down, flangeAt] = [[0, 0, -1] as Vector, Math.max(1.02 * R, d6 - 0.75 * R)];
  const first = d4 - foreOffset - (SEAM + 0.08) * R; // length of the neck about axis 4, and then about axis 5
  const second = d5 / 2 - 0.04 * R;
  const flange: ProfilePoint[] = [[0.86 * R, -(d6 - flangeAt)], [0.86 * R, -FLANGE_M], [0.7 * R, -FLANGE_M], [0.7 * R, 0], [0, 0]];
  return [
    { link: 4, name: "wrist_2_neck", origin: [0, 0, 0], axis: Y, colour: "shell", profile: neck(R, first) },
    ...housing(4, "wrist_2", [0, 0, 0], down, R, -second),
    seal(4, [0, 0, 0], Z, R, second + 0.04 * R),
    { link: 5, name: "wrist_3_neck", origin: [0, 0, 0], axis: [0, -1, 0], colour: "shell", profile: neck(R, d5 - second - 0.08 * R) },
    ...housing(5, "wrist_3", [0, 0, 0], down, R, -flangeAt + 0.08 * R),
    seal(5, [0, 0, 0], Z, R, flangeAt - 0.04 * R),
    { link: 6, name: "flange", origin: [0, 0, 0], axis: Z, colour: "metal", profile: flange },
  ];
}
