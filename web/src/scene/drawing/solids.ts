/**
 * Solids as drawings: each strip of a turned part becomes one filled outline with a gradient across it, farthest first.
 *
 * A strip, a cone's frustum, is convex: its outline is the hull of its two rings as the camera sees them.
 */

import { type Color, type PerspectiveCamera, Vector3 as ThreeVector } from "three";
import { type Pose, plus, transformed, type Vector } from "../../model/poses";
import { type ProfilePoint, ringPoints, type Turned, visibleStrips } from "../arm/turned";
import { brightness } from "../studio";

const RING_POINTS = 20;
const GRADIENT_DEG = [-75, -40, -5, 30, 70]; // where the light is computed across a strip
const FACE = 0.75; // share of a strip's normal along its axis above which it is a face, not a side

/** A filled outline with its distance from the camera. */
interface Shape {
  readonly depth: number; // [m]
  readonly svg: string;
}

/** Where the camera sees a point: [px], and its distance [m]. */
export interface Seen {
  readonly x: number;
  readonly y: number;
  readonly depth: number;
}

/** A camera as a drawing needs it. */
export class Projection {
  private readonly place: ThreeVector;

  constructor(
    private readonly camera: PerspectiveCamera,
    readonly width: number,
    readonly height: number,
  ) {
    camera.updateMatrixWorld();
    this.place = camera.getWorldPosition(new ThreeVector());
  }

  see(point: Vector): Seen {
    const p = new ThreeVector(...point);
    const depth = p.distanceTo(this.place);
    p.project(this.camera);
    return { x: ((p.x + 1) * this.width) / 2, y: ((1 - p.y) * this.height) / 2, depth };
  }

  /** Whether a point is before the camera. */
  faces(point: Vector): boolean {
    return new ThreeVector(...point).applyMatrix4(this.camera.matrixWorldInverse).z < -this.camera.near;
  }

  /** Returns a direction as the camera sees it: x right, y up, z towards it. */
  turn(direction: Vector): ThreeVector {
    return new ThreeVector(...direction).transformDirection(this.camera.matrixWorldInverse);
  }
}

/** Returns the outlines of one of an arm's parts at the pose of its link; `id` makes the names of its gradients unique. */
export function shapesOf(part: Turned, parts: readonly Turned[], pose: Pose, colour: Color, view: Projection, id: string): Shape[] {
  return visibleStrips(part, parts).flatMap((i) => {
    const strip = stripOf(part, pose, [part.profile[i]!, part.profile[i + 1]!], colour, view, `${id}-${i}`);
    return strip ? [strip] : [];
  });
}

/** Returns the outline of a whole part, without inner lines: for ghosts. */
export function outlineOf(part: Turned, pose: Pose, view: Projection): Seen[] {
  return hull(part.profile.flatMap((point) => ring(part, pose, point)).map((point) => view.see(point)));
}

function stripOf(part: Turned, pose: Pose, ends: readonly [ProfilePoint, ProfilePoint], colour: Color, view: Projection, id: string): Shape | null {
  const [[r0, z0], [r1, z1]] = ends;
  const length = Math.hypot(r1 - r0, z1 - z0);
  if (length < 1e-7) return null;
  const axis = view.turn(directionIn(pose, part.axis));
  const slope = (r0 - r1) / length; // of the normal along the axis
  const face = Math.abs(slope) > FACE;
  if (face && axis.z * Math.sign(slope) <= 0) return null; // seen from behind
  const seen = ends.flatMap((point) => ring(part, pose, point)).map((point) => view.see(point));
  const outline = hull(seen);
  const depth = seen.reduce((sum, point) => sum + point.depth, 0) / seen.length;
  const sight = axis.clone().multiplyScalar(Math.sign(slope));
  const fill = face ? shaded(colour, brightness(sight.x, sight.y, sight.z)) : `url(#${id})`;
  const gradient = face ? "" : gradientOf(part, pose, ends, axis, colour, view, id);
  const nearer = face ? 0.002 : 0; // a face lies on the solid that it closes
  return { depth: depth - nearer - 0.5 * Math.max(r0, r1), svg: `${gradient}<path d="${pathOf(outline)}Z" fill="${fill}"/>` };
}

/** Returns the gradient of a strip's side, from one edge of its outline to the other. */
function gradientOf(part: Turned, pose: Pose, [[r0, z0], [r1, z1]]: readonly [ProfilePoint, ProfilePoint], axis: ThreeVector, colour: Color, view: Projection, id: string): string {
  const aside = new ThreeVector(-axis.y, axis.x, 0);
  if (aside.length() < 1e-6) aside.set(1, 0, 0);
  aside.normalize();
  const towards = aside.clone().cross(axis);
  if (towards.z < 0) towards.negate();
  const middle = view.see(transformed(pose, plus(part.origin, part.axis, (z0 + z1) / 2)));
  const widest = Math.max(...ring(part, pose, [Math.max(r0, r1), (z0 + z1) / 2]).map((point) => reachOf(view.see(point), middle, aside)));
  const stops = GRADIENT_DEG.map((degrees) => {
    const [s, c] = [Math.sin((degrees * Math.PI) / 180), Math.cos((degrees * Math.PI) / 180)];
    const n = aside.clone().multiplyScalar(s).addScaledVector(towards, c);
    return `<stop offset="${((1 + s) / 2).toFixed(2)}" stop-color="${shaded(colour, brightness(n.x, n.y, n.z))}"/>`;
  });
  const end = (sign: number): string[] => [middle.x + sign * widest * aside.x, middle.y - sign * widest * aside.y].map((value) => value.toFixed(1));
  const [[x1, y1], [x2, y2]] = [end(-1), end(1)];
  return `<linearGradient id="${id}" gradientUnits="userSpaceOnUse" x1="${x1}" y1="${y1}" x2="${x2}" y2="${y2}">${stops.join("")}</linearGradient>`;
}

function reachOf(point: Seen, middle: Seen, aside: ThreeVector): number {
  return Math.abs((point.x - middle.x) * aside.x - (point.y - middle.y) * aside.y);
}

function ring(part: Turned, pose: Pose, point: ProfilePoint): Vector[] {
  return ringPoints(part, point, RING_POINTS).map((at) => transformed(pose, at));
}

function directionIn(pose: Pose, axis: Vector): Vector {
  return plus(transformed(pose, axis), transformed(pose, [0, 0, 0]), -1);
}

/** Returns a colour in some light, as text. */
function shaded(colour: Color, light: number): string {
  return `#${colour.clone().multiplyScalar(Math.min(1, light)).getHexString()}`;
}

/** Returns points as the beginning of an SVG path. */
export function pathOf(points: readonly Seen[]): string {
  return points.map(({ x, y }, i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
}

/** Returns the convex hull of points on the screen. Source: Andrew's monotone chain. */
function hull(points: readonly Seen[]): Seen[] {
  const sorted = [...points].sort((a, b) => a.x - b.x || a.y - b.y);
  const half = (list: readonly Seen[]): Seen[] => {
    const kept: Seen[] = [];
    for (const point of list) {
      while (kept.length > 1 && turnOf(kept.at(-2)!, kept.at(-1)!, point) <= 0) kept.pop();
      kept.push(point);
    }
    return kept.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

function turnOf(a: Seen, b: Seen, c: Seen): number {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}
