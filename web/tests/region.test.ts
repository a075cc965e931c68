import { BoxGeometry, Mesh, PerspectiveCamera, PlaneGeometry, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { both, EVERYWHERE, regionOf } from "../src/scene/region";

const camera = new PerspectiveCamera(34, 2, 0.03, 60);
camera.up.set(0, 0, 1);
camera.position.set(2, -3, 1.5);
camera.lookAt(0, 0, 0.5);
camera.setViewOffset(1440, 720, 100, -40, 1440, 720);
camera.updateMatrixWorld();

function box(x: number, y: number, z: number): Mesh {
  const mesh = new Mesh(new BoxGeometry(0.2, 0.3, 0.4));
  mesh.position.set(x, y, z);
  mesh.rotation.set(0.4, 0.5, 0.6);
  return mesh;
}

/** Where the camera sees the vertices of a mesh, moved straight down to a height where one is given. */
function places(mesh: Mesh, down: number | null = null): Vector3[] {
  const at = mesh.geometry.getAttribute("position");
  mesh.updateMatrixWorld();
  return Array.from({ length: at.count }, (_, i) => {
    const vertex = new Vector3().fromBufferAttribute(at, i).applyMatrix4(mesh.matrixWorld);
    return (down === null ? vertex : vertex.setZ(down)).project(camera);
  });
}

describe("the region of what moves", () => {
  it("has every vertex of it and of its shadow", () => {
    const things = [box(0.3, 0.1, 0.6), box(-0.4, 0.2, 1.1)];
    const { left, right, bottom, top } = regionOf(things, camera, 0);
    for (const { x, y } of things.flatMap((thing) => [...places(thing), ...places(thing, 0)])) {
      expect(x).toBeGreaterThan(left);
      expect(x).toBeLessThan(right);
      expect(y).toBeGreaterThan(bottom);
      expect(y).toBeLessThan(top);
    }
  });

  it("is a small part of the picture, smaller without the shadow", () => {
    const area = (floorZ: number | null): number => {
      const { left, right, bottom, top } = regionOf([box(0.3, 0.1, 0.6)], camera, floorZ);
      return ((right - left) * (top - bottom)) / 4;
    };
    expect(area(0)).toBeLessThan(0.2);
    expect(area(null)).toBeLessThan(0.7 * area(0));
  });

  it("leaves out what is hidden, and is everything where something is behind the camera", () => {
    const hidden = new Mesh(new PlaneGeometry(9, 9));
    hidden.visible = false;
    expect(regionOf([box(0, 0, 0.5), hidden], camera, null)).toEqual(regionOf([box(0, 0, 0.5)], camera, null));
    expect(regionOf([box(3, -4.5, 2)], camera, null)).toEqual(EVERYWHERE);
  });

  it("joins with that of the frame before", () => {
    expect(both({ left: -1, right: 0, bottom: 0, top: 0.5 }, { left: -0.5, right: 0.2, bottom: -0.1, top: 0.4 })).toEqual({
      left: -1, right: 0.2, bottom: -0.1, top: 0.5,
    });
  });
});
