/** Marks in the scene: the target and its bin, nearest, landings, bodies, what stands in the way, a real arm's ring. */

import { Mesh, type Object3D, TorusGeometry } from "three";
import type { CellGeometry } from "../model/cell";
import { linkPoses } from "../model/chain";
import { axisOf, plus, positionOf, transformed, type Vector } from "../model/poses";
import type { Ellipse, Landing, Obstacle, Target } from "./interface";
import { polyline, segments } from "./lines";
import type { Palette } from "./palette";
import { errorEllipse } from "./plan";
import { arrow, bin, body, bullseye, disc, ellipsePoints, flat, ring } from "./shapes";
import { Vector3 as ThreeVector } from "three";

export const TARGET_RADIUS_M = 0.07; // [m] of the drawn bull's eye
export const LIFT_M = 0.26; // [m] length of the arrow that lifts the target
const RAISED_M = 0.01; // [m] a target above it stands on a stem
const HAZARD_STRIPES = 24;

/** Returns the target, with its bin, on a stem where it is above the floor; `dragged` adds the arrow that lifts it. */
export function targetThings(target: Target, floorZ: number, palette: Palette, dragged: boolean): Object3D[] {
  const at = target.position;
  const radius = target.opening ? Math.min(TARGET_RADIUS_M, 0.7 * target.opening.radius_m) : TARGET_RADIUS_M;
  const things = bullseye(at, radius, palette.target);
  if (at[2] > floorZ + RAISED_M) {
    const foot: Vector = [at[0], at[1], floorZ];
    things.push(segments([foot, at], { colour: palette.target, width: 1.4, opacity: 0.6 }), disc(foot, 0.02, palette.target, 0.5));
  }
  if (target.opening) things.push(...bin(at, target.opening.radius_m, target.opening.rim_height_m, palette.target));
  if (dragged) things.push(ring(at, 1.45 * radius, 1.6 * radius, palette.target, 0.8), ...arrow(at, [0, 0, LIFT_M], palette.target));
  return things;
}

/** Returns the nearest target or release that can be done: a ghost ring to click. */
export function nearestThings(at: Vector, palette: Palette): Object3D[] {
  return [
    ring(at, 0.062, 0.076, palette.nearest, 0.95),
    ring(at, 0.1, 0.106, palette.nearest, 0.6),
    disc(at, 0.062, palette.nearest, 0.22),
  ];
}

/** Returns the landings that were observed, and the ellipse that is expected of them. */
export function landingThings(landings: readonly Landing[], ellipse: Ellipse | null, palette: Palette): Object3D[] {
  const dots = landings.map(({ position, newest }) => disc(plus(position, [0, 0, 0.003]), newest ? 0.018 : 0.011, palette.landing, newest ? 1 : 0.7));
  const newest = landings.filter((landing) => landing.newest).map(({ position }) => ring(position, 0.026, 0.031, palette.landing));
  const points = ellipse ? ellipsePoints(ellipse.center, ellipse.covariance_m2, ellipse.height_m) : null;
  return [...dots, ...newest, ...(points ? errorEllipse(points, palette.landing) : [])];
}

/** Returns the bodies of a cell: walls that the tool stays within, and bodies that nothing enters. */
export function bodyThings(cell: CellGeometry, palette: Palette): Object3D[] {
  return [
    ...cell.keepIn.flatMap((item) => body(item, palette.keepIn, 0)),
    ...cell.keepOut.flatMap((item) => body(item, palette.keepOut, 0.22)),
  ];
}

/** Returns what stands in the way: the body in red, a ring about the joint, the arm's reach. */
export function obstacleThings(obstacles: readonly Obstacle[], cell: CellGeometry, q: ArrayLike<number>, palette: Palette): Object3D[] {
  return obstacles.flatMap((obstacle) => {
    const walls = obstacle.constraint === "keep_in" ? cell.keepIn.filter(({ name }) => obstacle.names.includes(name)) : [];
    const met = obstacle.constraint === "keep_in" ? [] : cell.keepOut.filter(({ name }) => obstacle.names.includes(name));
    const things = [...walls.flatMap((each) => body(each, palette.obstacle, 0.06, 2.4)), ...met.flatMap((each) => body(each, palette.obstacle, 0.4, 2.4))];
    if (obstacle.joint !== null) things.push(jointRing(cell, q, obstacle.joint, palette));
    if (obstacle.constraint === "reach" && obstacle.limit) things.push(...reachThings(cell, q, obstacle.limit, palette));
    if (obstacle.constraint === "floor") things.push(floorSquare(cell, palette));
    return things;
  });
}

function jointRing(cell: CellGeometry, q: ArrayLike<number>, joint: number, palette: Palette): Object3D {
  const frame = linkPoses(cell.chain, q)[joint]!;
  const housing = cell.capsules.find((capsule) => capsule.frame === joint && capsule.from[0] === 0 && capsule.name !== "foot");
  const middle: Vector = housing ? [0, 0, (housing.from[2] + housing.to[2]) / 2] : [0, 0, 0];
  const torus = new Mesh(new TorusGeometry(1.35 * (housing?.radius ?? 0.06), 0.009, 10, 48), flat(palette.obstacle));
  torus.position.set(...transformed(frame, middle));
  torus.quaternion.setFromUnitVectors(new ThreeVector(0, 0, 1), new ThreeVector(...axisOf(frame, 2)));
  return torus;
}

/** Returns the arm's reach: the circle at the height of its shoulder, and one upright. */
function reachThings(cell: CellGeometry, q: ArrayLike<number>, reach: number, palette: Palette): Object3D[] {
  const centre = positionOf(linkPoses(cell.chain, q)[1]!);
  const circle = (u: Vector, v: Vector, turn: number): Vector[] =>
    Array.from({ length: 73 }, (_, i) => {
      const angle = (turn * i) / 72;
      return plus(plus(centre, u, reach * Math.cos(angle)), v, reach * Math.sin(angle));
    });
  const style = { colour: palette.obstacle, width: 2, opacity: 0.85, dash: 0.05 };
  return [
    polyline(circle([1, 0, 0], [0, 1, 0], 2 * Math.PI), style),
    polyline(circle([1, 0, 0], [0, 0, 1], Math.PI), style),
    polyline(circle([0, 1, 0], [0, 0, 1], Math.PI), style),
  ];
}

function floorSquare(cell: CellGeometry, palette: Palette): Object3D {
  const [x, y] = positionOf(cell.chain.base);
  return disc([x, y, cell.floorZ], 1.2, palette.obstacle, 0.16);
}

/** Returns the ring of stripes about the base of an arm that is real. */
export function hazardThings(cell: CellGeometry, palette: Palette): Object3D[] {
  const foot = cell.capsules.find((capsule) => capsule.name === "foot")?.radius ?? 0.1;
  const [x, y] = positionOf(cell.chain.base);
  const at: Vector = [x, y, cell.floorZ];
  const back = ring(at, foot + 0.05, foot + 0.11, palette.object);
  const stripes = Array.from({ length: HAZARD_STRIPES }, (_, i) => {
    const angle = (2 * Math.PI * i) / HAZARD_STRIPES;
    const point = (radius: number, turn: number): Vector => [x + radius * Math.cos(angle + turn), y + radius * Math.sin(angle + turn), cell.floorZ + 0.003];
    return [point(foot + 0.055, 0), point(foot + 0.105, 0.22)];
  });
  return [back, segments(stripes.flat(), { colour: palette.arm.seal!, width: 4 })];
}
