/** A picture on the floor: one pixel a landing cell. */

import { DataTexture, Mesh, MeshBasicMaterial, NearestFilter, PlaneGeometry, RGBAFormat, SRGBColorSpace } from "three";
import type { FloorMap } from "./interface";

const ABOVE_M = 0.001; // [m] over the floor, under every mark

/** Returns the picture as a thing of the scene. */
export function floorMapThings({ lower, upper, z, width, height, pixels }: FloorMap): Mesh[] {
  const texture = new DataTexture(pixels, width, height, RGBAFormat);
  texture.colorSpace = SRGBColorSpace;
  texture.magFilter = texture.minFilter = NearestFilter;
  texture.needsUpdate = true;
  const material = new MeshBasicMaterial({ map: texture, transparent: true, depthWrite: false });
  material.addEventListener("dispose", () => texture.dispose());
  const mesh = new Mesh(new PlaneGeometry(upper[0] - lower[0], upper[1] - lower[1]), material);
  mesh.position.set((lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2, z + ABOVE_M);
  mesh.renderOrder = -2; // before the arm's shadow
  return [mesh];
}
