/** The world's axes on the floor: letters at their ends, and a number at every metre. */

import { CanvasTexture, Color, Sprite, SpriteMaterial, SRGBColorSpace, type Object3D } from "three";
import type { Vector } from "../model/poses";
import { segments } from "./lines";
import type { Palette } from "./palette";

const LETTER_M = 0.45; // [m] length of an axis; longer than the foot of any arm is wide
const TEXT_PX = 44; // [px] of the drawn text, about three times as fine as it is seen
const SEEN = 0.026; // height of a number as a share of the view's
const SEEN_MIN_PX = 11; // [px] of it: a low view shows it no smaller
const ABOVE_M = 0.012; // [m] of the floor

/** Lines and labels of the axes, for the scene and for drawings. */
export interface AxisMarks {
  readonly lines: readonly { readonly from: Vector; readonly to: Vector; readonly axis: 0 | 1 | 2 }[];
  readonly labels: readonly { readonly at: Vector; readonly text: string; readonly beside: boolean }[];
}

/** Returns the world's axes at a floor, with numbers up to `extent` [m] from the origin. */
export function axisMarks(floorZ: number, extent: number): AxisMarks {
  const z = floorZ + ABOVE_M;
  const origin: Vector = [0, 0, z];
  const ends: Vector[] = [[LETTER_M, 0, z], [0, LETTER_M, z], [0, 0, z + LETTER_M]];
  const metres = Array.from({ length: Math.max(1, Math.ceil(extent)) }, (_, i) => i + 1).flatMap((m) => [m, -m]);
  return {
    lines: ends.map((to, i) => ({ from: origin, to, axis: i as 0 | 1 | 2 })),
    labels: [
      ...ends.map((at, i) => ({ at: at.map((value, j) => value + (i === j ? 0.05 : 0)) as unknown as Vector, text: "xyz"[i]!, beside: false })),
      ...metres.flatMap((m) => [
        { at: [m, 0, z] as const, text: metreText(m), beside: false },
        { at: [0, m, z] as const, text: metreText(m), beside: true }, // straight behind the arm and the letters
      ]),
    ],
  };
}

function metreText(m: number): string {
  return `${m < 0 ? "−" : ""}${Math.abs(m)} m`;
}

/** Returns them as things of a scene that is `height_px` high. */
export function axisThings(marks: AxisMarks, palette: Palette, height_px: number): Object3D[] {
  const seen = Math.max(SEEN, SEEN_MIN_PX / Math.max(1, height_px));
  const colours = [palette.target, palette.launch, palette.nearest];
  const lines = marks.lines.map(({ from, to, axis }) => segments([from, to], { colour: colours[axis]!, width: 2 }));
  return [...lines, ...marks.labels.map(({ at, text, beside }) => label(at, text, palette.brake, seen, beside))];
}

const textures = new Map<string, { readonly texture: CanvasTexture; readonly aspect: number }>();

function label(at: Vector, text: string, colour: Color, seen: number, beside: boolean): Sprite {
  const { texture, aspect } = textureOf(text, colour);
  const material = new SpriteMaterial({ map: texture, depthWrite: false, sizeAttenuation: false, transparent: true });
  const sprite = new Sprite(material);
  sprite.position.set(...at);
  sprite.center.set(beside ? -0.2 : 0.5, 0); // it stands on the floor
  sprite.scale.set(seen * aspect, seen, 1);
  return sprite;
}

/** Returns a drawn text; each is drawn once for a colour. */
function textureOf(text: string, colour: Color): { texture: CanvasTexture; aspect: number } {
  const key = `${text} ${colour.getHexString()}`;
  const known = textures.get(key);
  if (known) return known;
  const canvas = document.createElement("canvas");
  const font = `${TEXT_PX * 0.75}px system-ui, sans-serif`;
  const pen = canvas.getContext("2d")!;
  pen.font = font;
  canvas.width = Math.ceil(pen.measureText(text).width) + 8;
  canvas.height = TEXT_PX;
  pen.font = font; // a canvas forgets it with its size
  pen.fillStyle = `#${colour.getHexString()}`;
  pen.textBaseline = "middle";
  pen.fillText(text, 4, TEXT_PX / 2);
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  const made = { texture, aspect: canvas.width / canvas.height };
  textures.set(key, made);
  return made;
}
