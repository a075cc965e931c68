/** The scene as a vector drawing for a paper: white ground, grid of half metres, arm, ghosts, flight, target, labels. */

import type { Color, PerspectiveCamera } from "three";
import { type Body, linesOf } from "../../model/bodies";
import type { CellGeometry } from "../../model/cell";
import { linkPoses, toolPose } from "../../model/chain";
import { mainState } from "../../model/passages";
import { plus, positionOf, type Vector } from "../../model/poses";
import { axisMarks } from "../axes";
import type { Turned } from "../arm/turned";
import { tilesOf } from "../floor-map";
import type { Ellipse, FloorMap, Landing, Target } from "../interface";
import type { Palette } from "../palette";
import type { PlanMotion } from "../plan";
import { ellipsePoints } from "../shapes";
import { outlineOf, pathOf, Projection, type Seen, shapesOf } from "./solids";

const GRID_M = 0.5; // [m] between lines of the floor
const GRID_LINES = 5; // to each side of the middle of what is shown
const CIRCLE_POINTS = 48;
const LETTER_PX = 7; // [px] about the width of a letter

/** What a drawing shows. */
export interface Drawn {
  readonly cell: CellGeometry;
  readonly parts: readonly Turned[];
  readonly q: readonly number[];
  readonly object: Vector | null;
  readonly motion: PlanMotion | null;
  readonly target: Target | null;
  readonly landings: readonly Landing[];
  readonly ellipse: Ellipse | null;
  readonly map: FloorMap | null;
}

/** Returns a drawing as SVG text; `name` makes the names of its gradients unique on a page. */
export function drawing(drawn: Drawn, camera: PerspectiveCamera, width: number, height: number, palette: Palette, name = "part"): string {
  const pen = new Pen(new Projection(camera, width, height));
  const body = [
    ...floorLines(drawn, pen, palette),
    ...axisLines(drawn, pen, palette),
    ...mapAreas(drawn, pen),
    ...bodyLines(drawn.cell, pen, palette),
    ...markLines(drawn, pen, palette),
    ...ghostLines(drawn, pen, palette),
    ...armShapes(drawn, pen, palette, name),
    ...throwLines(drawn, pen, palette),
  ];
  const head = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img">`;
  const title = `<title>${drawn.motion ? "Planned throw" : "Arm"} of ${drawn.cell.robot}</title>`;
  return `${head}${title}<g stroke-linejoin="round" stroke-linecap="round" font-family="sans-serif" font-size="13">${body.join("\n")}</g></svg>\n`;
}

/** Writes lines and shapes of the world as SVG. */
class Pen {
  constructor(readonly view: Projection) {}

  line(points: readonly Vector[], colour: Color, width: number, more = ""): string {
    const seen = points.filter((point) => this.view.faces(point)).map((point) => this.view.see(point));
    return seen.length < 2 ? "" : `<path d="${pathOf(seen)}" fill="none" stroke="#${colour.getHexString()}" stroke-width="${width}"${more}/>`;
  }

  area(points: readonly Vector[], colour: Color, opacity: number, stroke = 0): string {
    return this.outline(points.map((point) => this.view.see(point)), colour, opacity, stroke);
  }

  outline(seen: readonly Seen[], colour: Color, opacity: number, stroke = 0): string {
    const hex = `#${colour.getHexString()}`;
    const edge = stroke ? ` stroke="${hex}" stroke-width="${stroke}" stroke-opacity="0.8"` : "";
    return `<path d="${pathOf(seen)}Z" fill="${hex}" fill-opacity="${opacity}"${edge}/>`;
  }

  /** Writes a text to the right of a point; of one in the picture no further to the right than there is room. */
  label(at: Vector, text: string, colour: Color): string {
    const { x, y } = this.view.see(at);
    const isSeen = x >= 0 && x <= this.view.width;
    const left = isSeen ? Math.max(0, Math.min(x + 10, this.view.width - text.length * LETTER_PX)) : x + 10;
    return `<text x="${left.toFixed(1)}" y="${(y - 8).toFixed(1)}" fill="#${colour.getHexString()}">${text}</text>`;
  }
}

function circle([x, y, z]: Vector, radius: number): Vector[] {
  return Array.from({ length: CIRCLE_POINTS + 1 }, (_, i) => {
    const angle = (2 * Math.PI * i) / CIRCLE_POINTS;
    return [x + radius * Math.cos(angle), y + radius * Math.sin(angle), z];
  });
}

function floorLines({ cell, motion }: Drawn, pen: Pen, palette: Palette): string[] {
  const [bx, by] = positionOf(cell.chain.base);
  const landing = motion?.plan.flight?.landing_point ?? [bx, by];
  const middle = (a: number, b: number): number => GRID_M * Math.round((a + b) / 2 / GRID_M);
  const [cx, cy, reach] = [middle(bx, landing[0]!), middle(by, landing[1]!), GRID_LINES * GRID_M];
  return Array.from({ length: 2 * GRID_LINES + 1 }, (_, i) => (i - GRID_LINES) * GRID_M).flatMap((step) => [
    pen.line([[cx + step, cy - reach, cell.floorZ], [cx + step, cy + reach, cell.floorZ]], palette.gridFine, 0.7),
    pen.line([[cx - reach, cy + step, cell.floorZ], [cx + reach, cy + step, cell.floorZ]], palette.gridFine, 0.7),
  ]);
}

function axisLines({ cell, motion }: Drawn, pen: Pen, palette: Palette): string[] {
  const landing = motion?.plan.flight?.landing_point ?? [1, 0];
  const marks = axisMarks(cell.floorZ, Math.max(2, Math.ceil(Math.hypot(landing[0]!, landing[1]!))));
  const colours = [palette.target, palette.launch, palette.nearest];
  return [
    ...marks.lines.map(({ from, to, axis }) => pen.line([from, to], colours[axis]!, 1.4)),
    ...marks.labels.filter(({ at }) => pen.view.faces(at)).map(({ at, text }) => pen.label(at, text, palette.brake)),
  ];
}

function mapAreas({ map }: Drawn, pen: Pen): string[] {
  const seen = map === null ? [] : tilesOf(map).filter(({ corners }) => corners.every((corner) => pen.view.faces(corner)));
  return seen.map(({ corners, colour, opacity }) => pen.area(corners, colour, Number(opacity.toFixed(2))));
}

function bodyLines(cell: CellGeometry, pen: Pen, palette: Palette): string[] {
  const lines = (bodies: readonly Body[], colour: Color): string[] => bodies.flatMap(linesOf).map((line) => pen.line(line, colour, 1));
  return [...lines(cell.keepIn, palette.keepIn), ...lines(cell.keepOut, palette.keepOut)];
}

function markLines({ target, landings, ellipse, motion }: Drawn, pen: Pen, palette: Palette): string[] {
  const planned = (motion?.plan as { landing_ellipse?: { center: [number, number]; covariance_m2: number[][] } | null } | undefined)?.landing_ellipse;
  const height = motion?.plan.flight?.landing_point[2] ?? 0;
  const ellipses = [
    planned ? { points: ellipsePoints(planned.center, planned.covariance_m2, height), colour: palette.flight } : null,
    ellipse ? { points: ellipsePoints(ellipse.center, ellipse.covariance_m2, ellipse.height_m), colour: palette.landing } : null,
  ];
  const bin = target?.opening;
  return [
    ...ellipses.flatMap((item) => (item?.points ? [pen.area(item.points, item.colour, 0.14, 1)] : [])),
    ...(target ? [pen.area(circle(target.position, 0.06), palette.target, 0.12, 1.6), pen.area(circle(target.position, 0.01), palette.target, 1)] : []),
    ...(target && bin ? [0, bin.rim_height_m].map((z) => pen.line(circle(plus(target.position, [0, 0, z]), bin.radius_m), palette.target, 1.3)) : []),
    ...landings.map(({ position, newest }) => pen.area(circle(position, newest ? 0.018 : 0.011), palette.landing, 0.8)),
  ];
}

function ghostLines({ cell, parts, motion }: Drawn, pen: Pen, palette: Palette): string[] {
  if (!motion) return [];
  const postures = [
    { t: 0, colour: palette.ghostStart, opacity: 0.1 },
    { t: motion.duration, colour: palette.ghostRest, opacity: 0.08 },
    { t: motion.releaseTime, colour: palette.ghostRelease, opacity: 0.16 },
  ];
  return postures.flatMap(({ t, colour, opacity }) => {
    const poses = linkPoses(cell.chain, motion.at(t).positions);
    return parts.filter((part) => part.link > 0 && part.name !== "seal").map((part) => pen.outline(outlineOf(part, poses[part.link]!, pen.view), colour, opacity));
  });
}

function armShapes({ cell, parts, q }: Drawn, pen: Pen, palette: Palette, name: string): string[] {
  const poses = linkPoses(cell.chain, q);
  const shapes = parts.flatMap((part, i) => shapesOf(part, parts, poses[part.link]!, palette.arm[part.colour] ?? palette.arrow, pen.view, `${name}-${i}`));
  return shapes.sort((a, b) => b.depth - a.depth).map((shape) => shape.svg);
}

function throwLines({ motion, object, cell, q }: Drawn, pen: Pen, palette: Palette): string[] {
  const at = object ?? positionOf(toolPose(cell.chain, q));
  const ball = pen.view.see(at);
  const rim = pen.view.see(plus(at, [0, 0, Math.max(cell.objectRadius, 0.018)]));
  const dot = `<circle cx="${ball.x.toFixed(1)}" cy="${ball.y.toFixed(1)}" r="${Math.hypot(rim.x - ball.x, rim.y - ball.y).toFixed(1)}" fill="#${palette.object.getHexString()}"/>`;
  if (!motion) return [dot];
  const [launch, brake] = motion.toolPath();
  const lines = [pen.line(brake, palette.brake, 1.2), pen.line(launch, palette.launch, 2.4)];
  if (!motion.flies) return [...lines, dot];
  const { flight } = motion.plan;
  const release = mainState(motion.plan);
  const [p, v] = [release.pose.position, release.twist.linear] as unknown as [Vector, Vector];
  return [
    ...lines,
    ...motion.windowFlights().map((points) => pen.line(points, palette.flight, 0.9, ' stroke-dasharray="6 4"')),
    ...[motion.flight(), ...motion.furtherFlights()].map((points) => pen.line(points, palette.flight, 2.2)),
    pen.line([p, plus(p, v, 0.09)], palette.arrow, 2),
    pen.label(plus(p, v, 0.09), `release, ${flight!.speed_m_s.toFixed(2)} m/s`, palette.arrow),
    pen.label(flight!.landing_point as unknown as Vector, `landing after ${flight!.time_of_flight_s.toFixed(2)} s`, palette.target),
    dot,
  ];
}
