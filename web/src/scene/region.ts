/** The part of the canvas that what moves covers: all that has to be drawn anew where drawing a pixel is dear. */

import { type Camera, Mesh, type Object3D, Sphere, Vector3 as ThreeVector } from "three";

const BLUR_M = 0.1; // [m] by which the shadow's soft edge reaches beyond what casts it
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => new ThreeVector(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1));

/** A rectangle in the coordinates of the clipped picture, −1 to 1 from left to right and from bottom to top. */
export interface Region {
  readonly left: number;
  readonly right: number;
  readonly bottom: number;
  readonly top: number;
}

const NOWHERE: Region = { left: 1, right: -1, bottom: 1, top: -1 };
export const EVERYWHERE: Region = { left: -1, right: 1, bottom: -1, top: 1 };

/** Returns the smallest region that has both. */
export function both(a: Region, b: Region): Region {
  return {
    left: Math.min(a.left, b.left),
    right: Math.max(a.right, b.right),
    bottom: Math.min(a.bottom, b.bottom),
    top: Math.max(a.top, b.top),
  };
}

/** Returns where the camera sees things, with their shadows on a floor at `floorZ` [m]; null: they cast none. */
export function regionOf(things: readonly Object3D[], camera: Camera, floorZ: number | null): Region {
  let region = NOWHERE;
  for (const thing of things) {
    thing.updateMatrixWorld();
    thing.traverseVisible((mesh) => {
      if (mesh instanceof Mesh) region = both(region, seen(around(mesh, floorZ), camera));
    });
  }
  return region;
}

/** Returns corners of boxes about a mesh, and about its shadow. */
function around(mesh: Mesh, floorZ: number | null): ThreeVector[] {
  if (mesh.geometry.boundingSphere === null) mesh.geometry.computeBoundingSphere();
  const { center, radius } = new Sphere().copy(mesh.geometry.boundingSphere!).applyMatrix4(mesh.matrixWorld);
  const corners = (reach: number): ThreeVector[] => CORNERS.map((corner) => center.clone().addScaledVector(corner, reach));
  return floorZ === null ? corners(radius) : [...corners(radius), ...corners(radius + BLUR_M).map((corner) => corner.setZ(floorZ))];
}

/** Returns where the camera sees points; everywhere, where one of them is behind it. */
function seen(points: readonly ThreeVector[], camera: Camera): Region {
  const inFront = points.every((point) => point.clone().applyMatrix4(camera.matrixWorldInverse).z < 0);
  if (!inFront) return EVERYWHERE;
  const places = points.map((point) => point.clone().project(camera));
  const [x, y] = [places.map((place) => place.x), places.map((place) => place.y)];
  return { left: Math.min(...x), right: Math.max(...x), bottom: Math.min(...y), top: Math.max(...y) };
}
