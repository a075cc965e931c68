/** Lines of constant width on the screen. */

import type { Color } from "three";
import { Line2 } from "three/addons/lines/Line2.js";
import { LineGeometry } from "three/addons/lines/LineGeometry.js";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import { distance, type Vector } from "../model/poses";

interface LineStyle {
  readonly colour: Color;
  readonly width: number; // [px]
  readonly opacity?: number;
  readonly dash?: number; // [m]; without it the line is solid
}

/** Returns a polyline. */
export function polyline(points: readonly Vector[], style: LineStyle): Line2 {
  const line = new Line2(new LineGeometry().setPositions(points.flat()), materialOf(style));
  if (style.dash) line.computeLineDistances();
  return line;
}

/** Returns separate segments, the points of each pair joined. */
export function segments(points: readonly Vector[], style: LineStyle): LineSegments2 {
  return new LineSegments2(new LineSegmentsGeometry().setPositions(points.flat()), materialOf(style));
}

/** Returns the points of a polyline without those closer than `step` [m] to the one before; its ends are kept. */
export function thinned(points: readonly Vector[], step: number): Vector[] {
  const kept: Vector[] = [];
  points.forEach((point, i) => {
    if (i === 0 || i === points.length - 1 || distance(point, kept.at(-1)!) >= step) kept.push(point);
  });
  return kept.length === 1 ? [kept[0]!, kept[0]!] : kept;
}

function materialOf({ colour, width, opacity = 1, dash }: LineStyle): LineMaterial {
  const material = new LineMaterial({ linewidth: width, transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
  material.color.copy(colour);
  if (dash) Object.assign(material, { dashed: true, dashSize: dash, gapSize: 0.8 * dash });
  return material;
}
