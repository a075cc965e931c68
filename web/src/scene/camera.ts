/** The camera: presets that show the whole throw, and the way from one to the next. */

import { type PerspectiveCamera, Vector3 as ThreeVector } from "three";
import { distance, type Vector } from "../model/poses";
import type { CameraPreset, Insets } from "./interface";

const MARGIN = 1.12; // of the view about what it is to show
const SETTLE_S = 0.35; // [s] time from one preset to the next

/** Place of the camera and the point it looks at. */
export interface View {
  readonly from: Vector;
  readonly to: Vector;
}

export const NO_INSETS: Insets = { left: 0, right: 0, top: 0, bottom: 0 };

/** Moves the middle of the picture into the middle of what is not covered, as a lens that is shifted does. */
export function shiftLens(camera: PerspectiveCamera, width: number, height: number, { left, right, top, bottom }: Insets): void {
  camera.setViewOffset(width, height, (right - left) / 2, (bottom - top) / 2, width, height);
}

/** What a view is to show: points of the throw, the arm's base, and the direction of the throw. */
export interface Subject {
  readonly points: readonly Vector[];
  readonly base: Vector;
  readonly direction: readonly [number, number]; // horizontal unit vector from the base towards the landing
  readonly landing: Vector | null;
}

/** What is not covered, as shares of the canvas. */
export interface FreeArea {
  readonly width: number;
  readonly height: number;
}

/** Returns the view of a preset. */
export function viewOf(preset: CameraPreset, subject: Subject, camera: PerspectiveCamera, free: FreeArea): View {
  const [x, y] = subject.direction;
  const side: Vector = [y, -x, 0]; // the throw goes from left to right
  const towards: Record<CameraPreset, Vector> = {
    overview: [0.86 * side[0] - 0.3 * x, 0.86 * side[1] - 0.3 * y, 0.42],
    side: [side[0], side[1], 0.06],
    top: [0, -0.001, 1], // x to the right, y upwards
    front: [x, y, 0.2],
    target: [-0.55 * x + 0.5 * side[0], -0.55 * y + 0.5 * side[1], 0.62],
  };
  const close = preset === "target" && subject.landing !== null;
  const points = close ? around(subject.landing!, 0.28) : subject.points;
  return framed(points, new ThreeVector(...towards[preset]).normalize(), camera, free);
}

/** Moves the camera from where it is to a view, in a third of a second. */
export class CameraMove {
  private started = 0;
  private from: [ThreeVector, ThreeVector] | null = null;
  private to: View | null = null;

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly target: ThreeVector,
  ) {}

  /** Begins to move; at once where there is nothing to follow or a person asks for less motion. */
  start(view: View, now: number, atOnce: boolean): void {
    this.to = view;
    this.started = atOnce ? Number.NEGATIVE_INFINITY : now;
    this.from = [this.camera.position.clone(), this.target.clone()];
  }

  /** Moves on; returns whether the camera is still on its way. */
  step(now: number): boolean {
    if (!this.to || !this.from) return false;
    const share = Math.min(1, (now - this.started) / (1000 * SETTLE_S));
    const eased = share * share * (3 - 2 * share);
    this.camera.position.lerpVectors(this.from[0], new ThreeVector(...this.to.from), eased);
    this.target.lerpVectors(this.from[1], new ThreeVector(...this.to.to), eased);
    if (share >= 1) this.to = null;
    return this.to !== null;
  }

  /** Goes to the end of its way. */
  finish(): void {
    if (this.to) this.step(Number.POSITIVE_INFINITY);
  }

  stop(): void {
    this.to = null;
  }
}

/** Returns the view from `direction` in which all points just fit. */
function framed(points: readonly Vector[], direction: ThreeVector, camera: PerspectiveCamera, free: FreeArea): View {
  const [right, up] = [new ThreeVector(0, 0, 1).cross(direction).normalize(), new ThreeVector()];
  up.crossVectors(direction, right);
  const seen = points.map((point) => new ThreeVector(...point));
  const middle = middleOf(seen, right, up, direction);
  const tangent = Math.tan((camera.fov * Math.PI) / 360);
  const away = seen.map((point) => {
    const offset = point.clone().sub(middle);
    const [x, y, z] = [Math.abs(offset.dot(right)), Math.abs(offset.dot(up)), offset.dot(direction)];
    return z + Math.max(y / (tangent * free.height), x / (tangent * camera.aspect * free.width)) * MARGIN;
  });
  const from = middle.clone().addScaledVector(direction, Math.max(0.5, ...away));
  return { from: from.toArray() as Vector, to: middle.toArray() as Vector };
}

function middleOf(points: readonly ThreeVector[], ...axes: readonly ThreeVector[]): ThreeVector {
  return axes.reduce((sum, axis) => {
    const along = points.map((point) => point.dot(axis));
    return sum.addScaledVector(axis, (Math.min(...along) + Math.max(...along)) / 2);
  }, new ThreeVector());
}

function around([x, y, z]: Vector, r: number): Vector[] {
  return [
    [x - r, y, z],
    [x + r, y, z],
    [x, y - r, z],
    [x, y + r, z],
    [x, y, z + r],
  ];
}

/** Returns the horizontal direction from the base to a point, forwards where it is above the base. */
export function directionTo(base: Vector, point: Vector): readonly [number, number] {
  const [x, y] = [point[0] - base[0], point[1] - base[1]];
  const length = distance([x, y, 0], [0, 0, 0]);
  return length > 1e-6 ? [x / length, y / length] : [1, 0];
}
