/** A picture on the floor: one pixel a landing cell. */

import { Color, DataTexture, Mesh, MeshBasicMaterial, NearestFilter, PlaneGeometry, RGBAFormat, SRGBColorSpace } from "three";
import type { Vector } from "../model/poses";
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

/** Landing cells side by side that look the same. */
export interface MapTile {
  readonly corners: readonly Vector[];
  readonly colour: Color;
  readonly opacity: number;
}

/** Returns the picture as areas, for a drawing: one a run of equal landing cells along x. */
export function tilesOf(map: FloorMap): MapTile[] {
  return Array.from({ length: map.height }, (_, row) => row).flatMap((row) => tilesOfRow(map, row));
}

function tilesOfRow(map: FloorMap, row: number): MapTile[] {
  const words = new Uint32Array(map.pixels.slice(4 * row * map.width, 4 * (row + 1) * map.width).buffer);
  const tiles: MapTile[] = [];
  for (let from = 0, to = 0; from < map.width; from = to) {
    while (to < map.width && words[to] === words[from]) to += 1;
    const [r = 0, g = 0, b = 0, a = 0] = map.pixels.subarray(4 * (row * map.width + from));
    if (a > 0) tiles.push({ corners: cornersOf(map, row, from, to), colour: new Color().setRGB(r / 255, g / 255, b / 255, SRGBColorSpace), opacity: a / 255 });
  }
  return tiles;
}

function cornersOf({ lower, upper, width, height, z }: FloorMap, row: number, from: number, to: number): Vector[] {
  const x = (column: number): number => lower[0] + ((upper[0] - lower[0]) * column) / width;
  const y = (line: number): number => lower[1] + ((upper[1] - lower[1]) * line) / height;
  return [[x(from), y(row), z], [x(to), y(row), z], [x(to), y(row + 1), z], [x(from), y(row + 1), z]];
}
