import { describe, expect, it } from "vitest";
import { type Chain, linkPoses, toolPose, toolState } from "../src/model/chain";
import { fly, path } from "../src/model/flight";
import { cross, plus, type Pose, poseOfRows, quaternionOf, quaternionOfPose, rotationVectorOf, type Vector } from "../src/model/poses";
import { durationOf, stateAt } from "../src/model/samples";
import numbers from "./model-numbers.json";

const TOLERANCE = 1e-12; // [m, 1] rounding, on nine arms

/** One row of a Denavit–Hartenberg table in the distal convention: lengths [m], twist [rad]. */
interface DhRow {
  readonly a: number;
  readonly d: number;
  readonly alpha: number;
}

/** Returns M = Tz(d) Tx(a) Rx(alpha) of one row, exact at quarter turns, where floats leave 6e-17. */
function transformOfRow({ a, d, alpha }: DhRow): Pose {
  const exact = (value: number): number => (Math.abs(value) < Number.EPSILON ? 0 : value);
  const [c, s] = [exact(Math.cos(alpha)), exact(Math.sin(alpha))];
  return Float64Array.of(1, 0, 0, a, 0, c, -s, 0, 0, s, c, d, 0, 0, 0, 1);
}

function chainOf(arm: (typeof numbers.arms)[number]): Chain {
  const transforms = arm.transforms
    ? arm.transforms.map(poseOfRows)
    : arm.a!.map((a, i) => transformOfRow({ a, d: arm.d![i]!, alpha: arm.alpha[i]! }));
  return { base: poseOfRows(arm.base), transforms, tool: poseOfRows(arm.tool) };
}

function expectNear(found: ArrayLike<number>, meant: readonly number[], tolerance = TOLERANCE): void {
  const worst = Math.max(...meant.map((value, i) => Math.abs(value - found[i]!)));
  expect(found.length).toBe(meant.length);
  expect(worst).toBeLessThanOrEqual(tolerance);
}

const rows = (pose: Pose): Float64Array => pose.subarray(0, 12);

describe.each(numbers.arms)("$name, calibrated: $calibrated", (arm) => {
  it("has the links, the tool and its velocity where the planner has them", () => {
    arm.positions.forEach((q, n) => {
      linkPoses(chainOf(arm), q)
        .slice(1)
        .forEach((pose, i) => expectNear(rows(pose), arm.links[n]![i]!.flat()));
      expectNear(rows(toolPose(chainOf(arm), q)), arm.tool_pose[n]!.flat());
      const state = toolState(chainOf(arm), q, arm.velocities[n]!);
      expectNear(rows(state.pose), arm.tool_pose[n]!.flat());
      expectNear(state.velocity, arm.tool_velocity[n]!, 1e-11); // [m/s] of joints at up to 3 rad/s
    });
  });
});

describe.each(numbers.flights)("flight with drag $drag from height $position.2 to $plane_z", (flight) => {
  const [p, v] = [flight.position as unknown as Vector, flight.velocity as unknown as Vector];

  it("lands where the planner's does", () => {
    const found = fly(p, v, flight.plane_z, flight);
    expect(found === null).toBe(flight.landing === null);
    if (!found || !flight.landing) return;
    expectNear(found.landingPoint, flight.landing.point);
    expectNear(found.landingVelocity, flight.landing.velocity);
    expectNear([found.timeOfFlight, found.apexHeight], [flight.landing.time_of_flight_s, flight.landing.apex_height_m]);
  });

  it("goes the planner's way", () => {
    path(p, v, flight.times, flight).forEach((point, i) => expectNear(point, flight.path[i]!));
  });
});

it("takes flights of both kinds, and some that never come down to their plane", () => {
  const landed = numbers.flights.map((flight) => flight.landing !== null);
  expect(new Set(landed)).toEqual(new Set([true, false]));
});

it("has the motion between samples as the planner has it, clipped to its ends", () => {
  const { samples, sample_rate_hz, times, found } = numbers.motion;
  expect(durationOf(samples, sample_rate_hz)).toBe(0.032);
  times.forEach((t, i) => {
    const state = stateAt(samples, sample_rate_hz, t);
    expectNear(state.positions, found.positions[i]!);
    expectNear(state.velocities, found.velocities[i]!);
    expectNear(state.accelerations, found.accelerations[i]!, 1e-11);
  });
});

it("turns rotation vectors into quaternions and back", () => {
  expectNear(quaternionOf([0, 0, Math.PI / 2]), [0, 0, Math.SQRT1_2, Math.SQRT1_2]);
  expectNear(quaternionOf([0, 0, 0]), [0, 0, 0, 1]);
  expectNear(rotationVectorOf([-0.5, 0.5, 0.5, -0.5]), [(2 * Math.PI) / 3 / Math.sqrt(3), ...[1, 1].map(() => (-2 * Math.PI) / 3 / Math.sqrt(3))]);
  for (const rotation of [[0.3, -1.2, 0.7], [1e-11, 0, 0], [0, 3.14, 0]] as const) expectNear(rotationVectorOf(quaternionOf(rotation)), rotation);
});

/** Rotates a vector by a quaternion: v + 2 u × (u × v + w v). */
function rotated([x, y, z, w]: readonly [number, number, number, number], v: Vector): Vector {
  const u: Vector = [x, y, z];
  return plus(v, cross(u, plus(cross(u, v), v, w)), 2);
}

it("turns poses into quaternions that turn the axes as the poses do", () => {
  const halfTurns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => [0, 1, 2].map((i) => [0, 1, 2].map((j) => (i === j ? (axis[i] ? 1 : -1) : 0))));
  const turns = [...numbers.arms.flatMap((arm) => arm.tool_pose), ...halfTurns];
  for (const matrix of turns) {
    const quaternion = quaternionOfPose(poseOfRows(matrix.map((row) => [...row.slice(0, 3), 0])));
    ([[1, 0, 0], [0, 1, 0], [0, 0, 1]] as const).forEach((axis, i) => expectNear(rotated(quaternion, axis), matrix.map((row) => row[i]!)));
  }
});
