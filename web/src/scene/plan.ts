/** What a plan looks like: the way of the tool, the release, the flight, early and late landings, three ghosts. */

import type { Object3D } from "three";
import type { CellGeometry } from "../model/cell";
import { toolPose, toolState } from "../model/chain";
import { type Air, fly, path, sampledPath } from "../model/flight";
import { plus, positionOf, scaled, type Vector } from "../model/poses";
import { MovingTarget } from "../model/moving";
import { endIndex, mainState, mainTime } from "../model/passages";
import { durationOf, endOf, type JointState, type Samples, stateAt } from "../model/samples";
import type { Plan } from "../service/types";
import type { Target } from "./interface";
import { polyline, thinned } from "./lines";
import type { Palette } from "./palette";
import { area, arrow, disc, ellipsePoints, ring } from "./shapes";

const STEP_M = 0.006; // [m] between drawn points of the tool's way
const FLIGHT_POINTS = 64;
const SPEED_SCALE_S = 0.09; // [s] the release arrow shows this much of the flight
const LANDING_M = 0.03; // [m] outer radius of a landing mark

/** A plan as geometry in the world. */
export class PlanMotion {
  readonly samples: Samples;
  readonly rate: number;
  readonly releaseTime: number;
  readonly duration: number; // [s] of the arm's motion
  readonly end: number; // [s] of everything: arm at rest and object landed
  readonly flies: boolean;
  readonly target: MovingTarget | null; // one that stands is the request's
  private readonly p: Vector;
  private readonly v: Vector; // of the object as it leaves [m/s]
  private readonly speedFactor: number; // the object's speed over the tool's
  private readonly air: Air;
  private readonly flightTime: number;

  constructor(
    readonly plan: Plan,
    private readonly cell: CellGeometry,
  ) {
    this.samples = plan.trajectory as unknown as Samples;
    this.rate = plan.sample_rate_hz;
    this.releaseTime = mainTime(plan);
    this.duration = durationOf(this.samples, this.rate);
    this.flies = plan.flight !== null && plan.flight !== undefined;
    this.flightTime = plan.flight?.time_of_flight_s ?? 0;
    this.target = MovingTarget.of(plan, cell.chain.base);
    this.end = endOf(plan);
    this.p = mainState(plan).pose.position as unknown as Vector;
    this.speedFactor = plan.flight?.release_speed_factor ?? 1;
    this.v = scaled(mainState(plan).twist.linear as unknown as Vector, this.speedFactor);
    this.air = { gravity: cell.air.gravity, drag: plan.flight?.drag_per_m ?? cell.air.drag };
  }

  /** Returns the state of the joints at a time [s]. */
  at(t: number): JointState {
    return stateAt(this.samples, this.rate, t);
  }

  /** Returns where the object is at a time [s]: in the tool, in flight, where it landed, at rest or carried on. */
  objectAt(t: number): Vector {
    if (!this.flies || t < this.releaseTime) return positionOf(toolPose(this.cell.chain, this.at(t).positions));
    const flown = t - this.releaseTime;
    const there = path(this.p, this.v, [Math.min(flown, this.flightTime)], this.air)[0]!;
    return this.target ? plus(there, this.target.velocity, Math.max(0, flown - this.flightTime)) : there;
  }

  /** Returns the target that moves as it is at a time [s]; null where none does. */
  targetAt(t: number): Target | null {
    return this.target && { position: this.target.at(t), opening: this.target.opening };
  }

  /** Returns the way of the tool, cut at the release, or where the last passage ends. */
  toolPath(): [Vector[], Vector[]] {
    const points = this.samples.positions.map((q) => positionOf(toolPose(this.cell.chain, q)));
    const k = endIndex(mainState(this.plan));
    return [thinned(points.slice(0, k + 1), STEP_M), thinned(points.slice(k), STEP_M)];
  }

  /** Returns both ends of each straight line that the tool passes. */
  lines(): Vector[][] {
    const lines = this.plan.passages?.filter((passage) => endIndex(passage) > passage.index) ?? [];
    return lines.map((line) => [line.index, endIndex(line)].map((k) => positionOf(toolPose(this.cell.chain, this.samples.positions[k]!))));
  }

  /** Returns the planned flight, empty for a move that ends at rest. */
  flight(): Vector[] {
    return this.flies ? sampledPath(this.p, this.v, this.flightTime, FLIGHT_POINTS, this.air) : [];
  }

  /** Returns the flights of other objects than the first, of a tool with several grippers. */
  furtherFlights(): Vector[][] {
    const others = this.plan.passages?.filter((passage) => passage.flight && passage.index !== mainState(this.plan).index) ?? [];
    return others.map((passage) => passage.flight!.object_path as unknown as Vector[]);
  }

  /** Returns the flights of a release as early and as late as the plan's window says; of another gripper's none. */
  windowFlights(): Vector[][] {
    if (this.plan.passages?.find((passage) => passage.releases)?.releases !== true && this.plan.passages) return [];
    const planeZ = this.plan.flight?.landing_point[2];
    const delays = this.plan.flight?.window.map((row) => row.delay_s) ?? [];
    if (planeZ === undefined || !delays.length) return [];
    const ends = [Math.min(...delays), Math.max(...delays)].filter((delay) => delay !== 0);
    return ends.flatMap((delay) => this.delayed(delay, planeZ));
  }

  private delayed(delay: number, planeZ: number): Vector[][] {
    const state = this.at(this.releaseTime + delay);
    const tool = toolState(this.cell.chain, state.positions, state.velocities);
    const p = positionOf(tool.pose);
    const v = scaled(tool.velocity, this.speedFactor);
    const flight = fly(p, v, planeZ, this.air);
    if (!flight) return [];
    return [sampledPath(p, v, flight.timeOfFlight, FLIGHT_POINTS, this.air)];
  }

  /** Returns the points that a camera should have in view. */
  extent(): Vector[] {
    const [launch, brake] = this.toolPath();
    return [...launch, ...brake, ...this.flight(), ...this.furtherFlights().flat()];
  }
}

/** Returns everything of a plan but its ghosts; a stale plan is drawn grey. */
export function planThings(motion: PlanMotion, palette: Palette, stale: boolean): Object3D[] {
  const [launch, brake] = motion.toolPath();
  const tone = stale ? { launch: palette.stale, flight: palette.stale, arrow: palette.stale } : palette;
  const opacity = stale ? 0.7 : 1;
  const things: Object3D[] = [
    polyline(launch, { colour: tone.launch, width: 3.2, opacity }),
    polyline(brake, { colour: palette.brake, width: 1.8, opacity: 0.75 }),
    ...motion.lines().map((points) => polyline(points, { colour: tone.launch, width: 7, opacity })),
  ];
  if (!motion.flies) return things;
  const { flight } = motion.plan;
  const release = mainState(motion.plan);
  const [p, v] = [release.pose.position, release.twist.linear] as unknown as [Vector, Vector];
  if (motion.target) things.push(polyline([motion.target.at(0), motion.target.at(motion.end)], { colour: palette.target, width: 1.6, opacity: 0.8, dash: 0.03 }));
  const landing = flight!.landing_point as unknown as Vector;
  return [
    ...things,
    polyline(motion.flight(), { colour: tone.flight, width: 3, opacity }),
    ...arrow(p, [SPEED_SCALE_S * v[0], SPEED_SCALE_S * v[1], SPEED_SCALE_S * v[2]], tone.arrow),
    disc(landing, 0.5 * LANDING_M, tone.flight),
    ...motion.furtherFlights().flatMap((points) => [polyline(points, { colour: tone.flight, width: 3, opacity }), disc(points.at(-1)!, 0.5 * LANDING_M, tone.flight)]),
    ...motion.windowFlights().flatMap((points) => windowThings(points, tone.flight)),
    ...ellipseThings(motion.plan, palette, stale),
  ];
}

function windowThings(points: readonly Vector[], colour: Palette["flight"]): Object3D[] {
  const line = polyline(points, { colour, width: 1.3, opacity: 0.55, dash: 0.025 });
  return [line, ring(points.at(-1)!, 0.55 * LANDING_M, 0.75 * LANDING_M, colour, 0.85)];
}

function ellipseThings(plan: Plan, palette: Palette, stale: boolean): Object3D[] {
  const ellipse = (plan as { landing_ellipse?: { center: [number, number]; covariance_m2: number[][] } | null }).landing_ellipse;
  if (!ellipse || !plan.flight) return [];
  const points = ellipsePoints(ellipse.center, ellipse.covariance_m2, plan.flight.landing_point[2]!);
  return points ? errorEllipse(points, stale ? palette.stale : palette.flight) : [];
}

/** Returns an error ellipse: its area and its edge. */
export function errorEllipse(points: readonly Vector[], colour: Palette["flight"]): Object3D[] {
  const edge = points.map((point) => plus(point, [0, 0, 0.003]));
  return [area(points, colour, 0.16), polyline(edge, { colour, width: 1.4, opacity: 0.9 })];
}
