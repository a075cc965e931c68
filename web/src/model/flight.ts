/**
 * Free flight of the object, as `planner/flight.py` has it: in closed form without drag; with drag (a = -g z - k |v| v)
 * by the classical fourth-order Runge–Kutta method.
 */

import { norm, type Vector } from "./poses";

const STEP_S = 0.004; // [s] Runge–Kutta step, the planner's
const FLIGHT_MAX_S = 30; // [s] longest flight that is integrated
const BISECTIONS = 50; // halvings of one step: to the last digit

/** Gravity [m/s²] and the constant k [1/m] of the drag's deceleration k |v|². */
export interface Air {
  readonly gravity: number;
  readonly drag: number;
}

/** A free flight from the release to the landing plane; lengths [m], velocities [m/s], time [s]. */
export interface Flight {
  readonly landingPoint: Vector;
  readonly landingVelocity: Vector;
  readonly timeOfFlight: number;
  readonly apexHeight: number;
}

type State = readonly [number, number, number, number, number, number]; // position, velocity

/** Returns the flight from a release down to the plane z = `planeZ`, null where it never reaches the plane. */
export function fly(p: Vector, v: Vector, planeZ: number, air: Air): Flight | null {
  if (air.drag > 0) return flyWithDrag(p, v, planeZ, air);
  const square = v[2] ** 2 + 2 * air.gravity * (p[2] - planeZ);
  const t = square >= 0 ? (v[2] + Math.sqrt(square)) / air.gravity : Number.NaN;
  if (!(t >= 0)) return null;
  return {
    landingPoint: [p[0] + v[0] * t, p[1] + v[1] * t, planeZ],
    landingVelocity: [v[0], v[1], v[2] - air.gravity * t],
    timeOfFlight: t,
    apexHeight: p[2] + Math.max(v[2], 0) ** 2 / (2 * air.gravity),
  };
}

/** Returns the object's positions [m] at increasing times [s] after the release. */
export function path(p: Vector, v: Vector, times: readonly number[], air: Air): Vector[] {
  if (!(air.drag > 0)) return times.map((t) => ballistic(p, v, t, air.gravity));
  let state: State = [...p, ...v];
  let before = 0;
  return times.map((t) => {
    const duration = t - before;
    const steps = Math.ceil(duration / STEP_S);
    for (let i = 0; i < steps; i++) state = step(state, duration / steps, air);
    before = t;
    return [state[0], state[1], state[2]];
  });
}

/** Returns `count` positions [m], evenly spaced in time over a flight of `duration` [s], its ends included. */
export function sampledPath(p: Vector, v: Vector, duration: number, count: number, air: Air): Vector[] {
  return path(p, v, Array.from({ length: count }, (_, i) => (duration * i) / (count - 1)), air);
}

function ballistic(p: Vector, v: Vector, t: number, gravity: number): Vector {
  return [p[0] + v[0] * t, p[1] + v[1] * t, p[2] + v[2] * t - 0.5 * gravity * t * t];
}

/** Returns the state one Runge–Kutta step of `h` [s] later. */
function step(state: State, h: number, air: Air): State {
  const k1 = rate(state, air);
  const k2 = rate(moved(state, k1, 0.5 * h), air);
  const k3 = rate(moved(state, k2, 0.5 * h), air);
  const k4 = rate(moved(state, k3, h), air);
  return state.map((x, i) => x + (h / 6) * (k1[i]! + 2 * k2[i]! + 2 * k3[i]! + k4[i]!)) as unknown as State;
}

function rate([, , , x, y, z]: State, { gravity, drag }: Air): State {
  const deceleration = drag * norm([x, y, z]);
  return [x, y, z, -deceleration * x, -deceleration * y, -deceleration * z - gravity];
}

function moved(state: State, rates: State, h: number): State {
  return state.map((x, i) => x + h * rates[i]!) as unknown as State;
}

function flyWithDrag(p: Vector, v: Vector, planeZ: number, air: Air): Flight | null {
  let state: State = [...p, ...v];
  let apexHeight = p[2];
  for (let t = 0; t < FLIGHT_MAX_S; t += STEP_S) {
    const following = step(state, STEP_S, air);
    if (state[5] > 0 && following[5] <= 0) apexHeight = step(state, crossing(state, air, 5, 0), air)[2];
    if (following[5] < 0 && following[2] < planeZ) {
      return state[2] >= planeZ ? landed(state, planeZ, t, apexHeight, air) : null;
    }
    state = following;
  }
  return null;
}

/** Returns the flight that falls through the plane within one step after `t` [s]. */
function landed(state: State, planeZ: number, t: number, apexHeight: number, air: Air): Flight {
  const rest = crossing(state, air, 2, planeZ);
  const [x, y, , ...landingVelocity] = step(state, rest, air);
  return { landingPoint: [x, y, planeZ], landingVelocity, timeOfFlight: t + rest, apexHeight };
}

/** Returns the time [s] within one step at which component `index` of the state falls through `level`. */
function crossing(state: State, air: Air, index: number, level: number): number {
  let [low, high] = [0, STEP_S];
  for (let i = 0; i < BISECTIONS; i++) {
    const middle = 0.5 * (low + high);
    if (step(state, middle, air)[index]! > level) low = middle;
    else high = middle;
  }
  return 0.5 * (low + high);
}
