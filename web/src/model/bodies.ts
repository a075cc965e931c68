/** Convex bodies of a cell's surroundings: boxes, cylinders, spheres and capsules, each with a pose. */

import { plus, scaled, transformed, type Pose, type Vector } from "./poses";

export interface Body {
  readonly name: string; // as violations and checks tell it
  readonly shape: "box" | "cylinder" | "sphere" | "capsule";
  readonly pose: Pose; // of its centre and axes in the world
  readonly extent: Vector; // along its own axes, round ends included [m]
}

const CORNERS = 48; // of a circle

/** Returns lines that show a body, each a row of points in the world: edges, rims and round outlines. */
export function linesOf({ shape, pose, extent }: Body): Vector[][] {
  const lines = { box: boxEdges, cylinder: cylinderLines, sphere: capsuleLines, capsule: capsuleLines }[shape](scaled(extent, 0.5));
  return lines.map((line) => line.map((point) => transformed(pose, point)));
}

function boxEdges(half: Vector): Vector[][] {
  const corner = (i: number): Vector => [i & 1 ? half[0] : -half[0], i & 2 ? half[1] : -half[1], i & 4 ? half[2] : -half[2]];
  return [0, 1, 2, 3, 4, 5, 6, 7].flatMap((i) => [1, 2, 4].filter((bit) => !(i & bit)).map((bit) => [corner(i), corner(i | bit)]));
}

function cylinderLines([radius, , half]: Vector): Vector[][] {
  const sides: Vector[] = [[radius, 0, 0], [0, radius, 0], [-radius, 0, 0], [0, -radius, 0]];
  return [...rims(radius, half), ...sides.map((side) => [plus(side, [0, 0, -half]), plus(side, [0, 0, half])])];
}

function capsuleLines([radius, , half]: Vector): Vector[][] {
  const straight = half - radius;
  const outline = (across: (away: number, z: number) => Vector): Vector[] =>
    circle((x, z) => across(x, z + (z < 0 ? -straight : straight)), radius);
  return [...rims(radius, straight), outline((x, z) => [x, 0, z]), outline((y, z) => [0, y, z])];
}

function rims(radius: number, half: number): Vector[][] {
  return (half > 0 ? [-half, half] : [0]).map((z) => circle((x, y) => [x, y, z], radius));
}

function circle(at: (x: number, y: number) => Vector, radius: number): Vector[] {
  return Array.from({ length: CORNERS + 1 }, (_, i) => at(radius * Math.cos((2 * Math.PI * i) / CORNERS), radius * Math.sin((2 * Math.PI * i) / CORNERS)));
}
