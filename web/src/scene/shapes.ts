/** Flat and simple shapes: rings, discs, ellipses, bodies, bins, arrows. */

import {
  BoxGeometry,
  BufferGeometry,
  CapsuleGeometry,
  CircleGeometry,
  type Color,
  ConeGeometry,
  CylinderGeometry,
  DoubleSide,
  Float32BufferAttribute,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  type Object3D,
  RingGeometry,
  SphereGeometry,
  Vector3 as ThreeVector,
} from "three";
import { norm, plus, type Vector } from "../model/poses";
import { linesOf, type Body } from "../model/bodies";
import { principalAxes } from "../model/spread";
import { segments } from "./lines";

const ABOVE_M = 0.002; // [m] between a mark and the surface it lies on
const ROUND = 48; // corners of a circle
const ELLIPSE_POINTS = 72;
// source: square root of the 95 % quantile of the chi-squared distribution with two degrees of freedom
const SIGMAS_95 = 2.4477;

/** Returns a material of one colour that takes no light. */
export function flat(colour: Color, opacity = 1): MeshBasicMaterial {
  return new MeshBasicMaterial({ color: colour, transparent: opacity < 1, opacity, depthWrite: opacity === 1, side: DoubleSide });
}

/** Returns a flat ring about a point. */
export function ring(at: Vector, inner: number, outer: number, colour: Color, opacity = 1): Mesh {
  return placed(new Mesh(new RingGeometry(inner, outer, ROUND), flat(colour, opacity)), at, ABOVE_M);
}

/** Returns a flat disc about a point. */
export function disc(at: Vector, radius: number, colour: Color, opacity = 1): Mesh {
  return placed(new Mesh(new CircleGeometry(radius, ROUND), flat(colour, opacity)), at, ABOVE_M);
}

/** Returns a ball about a point. */
export function ball(at: Vector, radius: number, colour: Color): Mesh {
  return placed(new Mesh(new SphereGeometry(radius, 20, 14), flat(colour)), at);
}

/** Returns a bull's eye about a point: ring, centre, four ticks. */
export function bullseye(at: Vector, radius: number, colour: Color): Object3D[] {
  const tick = (x: number, y: number): Vector[] => [
    plus(at, [x * 0.62 * radius, y * 0.62 * radius, ABOVE_M]),
    plus(at, [x * 1.38 * radius, y * 1.38 * radius, ABOVE_M]),
  ];
  return [
    ring(at, 0.86 * radius, radius, colour),
    disc(at, 0.16 * radius, colour),
    disc(at, radius, colour, 0.12),
    segments([tick(1, 0), tick(-1, 0), tick(0, 1), tick(0, -1)].flat(), { colour, width: 1.6 }),
  ];
}

/** Returns the points of the ellipse that holds 95 % of a normal distribution, null where there is none. */
export function ellipsePoints(centre: readonly [number, number], covariance: readonly (readonly number[])[], z: number): Vector[] | null {
  const axes = principalAxes(covariance[0]?.[0] ?? 0, covariance[0]?.[1] ?? 0, covariance[1]?.[1] ?? 0);
  if (axes === null) return null;
  const { turn } = axes;
  return Array.from({ length: ELLIPSE_POINTS + 1 }, (_, i) => {
    const angle = (2 * Math.PI * i) / ELLIPSE_POINTS;
    const [u, v] = [SIGMAS_95 * axes.long * Math.cos(angle), SIGMAS_95 * axes.short * Math.sin(angle)];
    return [centre[0] + u * Math.cos(turn) - v * Math.sin(turn), centre[1] + u * Math.sin(turn) + v * Math.cos(turn), z];
  });
}

/** Returns the area within a closed line of points, which is convex. */
export function area(points: readonly Vector[], colour: Color, opacity: number): Mesh {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(points.map(([x, y, z]) => [x, y, z + ABOVE_M]).flat(), 3));
  geometry.setIndex(points.slice(2).flatMap((_, i) => [0, i + 1, i + 2]));
  return new Mesh(geometry, flat(colour, opacity));
}

/** Returns a body: its outline and, where it is not all clear, its surface. */
export function body(item: Body, colour: Color, opacity: number, width = 1.2): Object3D[] {
  const points = linesOf(item).flatMap((line) => line.slice(1).flatMap((point, i) => [line[i]!, point]));
  const lines = segments(points, { colour, width, opacity: 0.9 });
  if (opacity === 0) return [lines];
  const material = new MeshBasicMaterial({ color: colour, transparent: true, opacity, depthWrite: false });
  const surface = new Mesh(surfaceOf(item), material);
  surface.applyMatrix4(new Matrix4().fromArray(item.pose).transpose());
  return [surface, lines];
}

/** Returns the surface of a body in its own frame; three.js has cylinders and capsules along y. */
function surfaceOf({ shape, extent: [x, y, z] }: Body): BufferGeometry {
  if (shape === "box") return new BoxGeometry(x, y, z);
  if (shape === "sphere") return new SphereGeometry(x / 2, ROUND, ROUND / 2);
  const upright = shape === "cylinder" ? new CylinderGeometry(x / 2, x / 2, z, ROUND) : new CapsuleGeometry(x / 2, z - x, ROUND / 4, ROUND);
  return upright.rotateX(Math.PI / 2);
}

/** Returns a round bin about a target: its wall, its rim and its bottom. */
export function bin(bottom: Vector, radius: number, height: number, colour: Color): Object3D[] {
  const wall = new Mesh(new CylinderGeometry(radius, radius, height, ROUND, 1, true), flat(colour, 0.16));
  wall.rotation.x = Math.PI / 2;
  return [
    placed(wall, plus(bottom, [0, 0, height / 2])),
    ring(plus(bottom, [0, 0, height]), 0.965 * radius, 1.02 * radius, colour),
    ring(bottom, 0.97 * radius, radius, colour, 0.6),
  ];
}

/** Returns an arrow from a point along a vector [m]; its width follows from its length. */
export function arrow(from: Vector, along: Vector, colour: Color, opacity = 1): Object3D[] {
  const length = norm(along);
  if (length < 1e-6) return [];
  const head = Math.min(0.4 * length, 0.06);
  const [shaft, tip] = [
    new Mesh(new CylinderGeometry(0.1 * head, 0.1 * head, length - head, 12), flat(colour, opacity)),
    new Mesh(new ConeGeometry(0.27 * head, head, 20), flat(colour, opacity)),
  ];
  const direction = new ThreeVector(...along).divideScalar(length);
  for (const [mesh, middle] of [
    [shaft, (length - head) / 2],
    [tip, length - head / 2],
  ] as const) {
    mesh.quaternion.setFromUnitVectors(new ThreeVector(0, 1, 0), direction);
    mesh.position.set(...from).addScaledVector(direction, middle);
  }
  return [shaft, tip];
}

function placed<T extends Object3D>(thing: T, at: Vector, above = 0): T {
  thing.position.set(at[0], at[1], at[2] + above);
  return thing;
}
