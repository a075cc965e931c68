/**
 * The studio in which everything solid stands: one small picture of a lit sphere ("matcap"), computed here.
 *
 * The light is looked up by the direction of the surface as the camera sees it. It costs one texture read a pixel, so
 * that a machine without a graphics processor draws the arm with soft boxes and rim light, too.
 */

import { Color, DataTexture, LinearFilter, MeshMatcapMaterial, RGBAFormat, SRGBColorSpace } from "three";

const SIZE = 128; // [px]

/** A light of the studio: direction as the camera sees it (x right, y up, z towards it), strength, sharpness. */
interface Light {
  readonly from: readonly [number, number, number];
  readonly strength: number;
  readonly sharpness: number; // exponent of its reflection; 0: diffuse
}

const LIGHTS: readonly Light[] = [
  { from: [-0.45, 0.75, 0.5], strength: 0.52, sharpness: 0 }, // key, from above on the left
  { from: [0.8, 0.25, 0.4], strength: 0.14, sharpness: 0 }, // fill
  { from: [-0.35, 0.6, 0.72], strength: 0.22, sharpness: 26 }, // soft box in the paint
  { from: [0.75, 0.5, 0.2], strength: 0.16, sharpness: 10 }, // its weaker neighbour
];
const SKY = 0.36; // ambient light from above
const GROUND = 0.2; // and from the floor
const RIM = 0.18; // light from behind, at grazing angles

/** Returns a material for solids with colours at their vertices. */
export function studioMaterial(): MeshMatcapMaterial {
  return new MeshMatcapMaterial({ matcap: sphere(), vertexColors: true });
}

let made: DataTexture | null = null;

/** Returns the picture of the lit sphere. */
export function sphere(): DataTexture {
  made ??= draw();
  return made;
}

function draw(): DataTexture {
  const pixels = new Uint8Array(4 * SIZE * SIZE);
  for (let row = 0; row < SIZE; row++) {
    for (let column = 0; column < SIZE; column++) {
      const x = ((column + 0.5) / SIZE) * 2 - 1;
      const y = ((row + 0.5) / SIZE) * 2 - 1;
      const rest = Math.max(0, 1 - x * x - y * y);
      const length = Math.hypot(x, y, Math.sqrt(rest));
      const shade = new Color().setScalar(Math.min(1, brightness(x / length, y / length, Math.sqrt(rest) / length)));
      const value = Math.round(255 * shade.convertLinearToSRGB().r);
      pixels.set([value, value, value, 255], 4 * (row * SIZE + column));
    }
  }
  const texture = new DataTexture(pixels, SIZE, SIZE, RGBAFormat);
  texture.colorSpace = SRGBColorSpace;
  texture.magFilter = texture.minFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

/** Returns the light that a surface facing (x, y, z) sends to the camera, 0 to 1. */
export function brightness(x: number, y: number, z: number): number {
  const ambient = GROUND + (SKY - GROUND) * (0.5 + 0.5 * y);
  const rim = RIM * (1 - z) ** 3 * (0.6 + 0.4 * y);
  const lit = LIGHTS.map(({ from, strength, sharpness }) => {
    const length = Math.hypot(...from);
    const facing = (x * from[0] + y * from[1] + z * from[2]) / length;
    return sharpness ? strength * Math.max(0, facing) ** sharpness : strength * Math.max(0, 0.75 * facing + 0.25);
  });
  return ambient + rim + lit.reduce((sum, light) => sum + light, 0);
}
