// What can be drawn over a plan's time, with its limits: from the trajectory's samples and the service's curves. Pure.

import type { Check, Curves, Plan } from "../service/types";

interface Line {
  readonly label: string;
  readonly values: readonly (number | null)[];
}

/** A limit of one line, or of all (`line` null). */
interface Limit {
  readonly value: number;
  readonly line: number | null;
}

export interface Quantity {
  readonly key: string;
  readonly label: string;
  readonly unit: string;
  readonly check: string | null; // name of the certificate's check
  readonly times: readonly number[]; // [s]
  readonly steps: boolean; // a value holds until the next instant
  readonly lines: readonly Line[];
  readonly limits: readonly Limit[];
}

export const JOINTS = ["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2", "Wrist 3"] as const;

/** Limits of the joints in the cell's model or the request, one a joint. */
export interface JointLimits {
  readonly lower: readonly number[] | null; // position [rad]
  readonly upper: readonly number[] | null;
  readonly velocity: readonly number[] | null;
  readonly acceleration: readonly number[] | null;
  readonly jerk: readonly number[] | null;
}

function joints(rows: readonly (readonly number[])[]): Line[] {
  return JOINTS.map((label, j) => ({ label, values: rows.map((row) => row[j] ?? null) }));
}

/** Both bounds of a magnitude; one pair for all joints where they are alike. */
function symmetric(limits: readonly number[] | null): Limit[] {
  if (limits === null) return [];
  const alike = limits.every((limit) => limit === limits[0]);
  const pairs = (value: number, line: number | null): Limit[] => [{ value, line }, { value: -value, line }];
  return alike && limits[0] !== undefined ? pairs(limits[0], null) : limits.flatMap((limit, j) => pairs(limit, j));
}

function positionLimits(limits: JointLimits): Limit[] {
  const { lower, upper } = limits;
  if (lower === null || upper === null) return [];
  return [...lower.map((value, line) => ({ value, line })), ...upper.map((value, line) => ({ value, line }))];
}

/** Jerk is constant within a tick: the change of the acceleration over it [rad/s³]. */
export function jerkOf(accelerations: readonly (readonly number[])[], rate_hz: number): number[][] {
  return accelerations.map((row, i) => {
    const next = accelerations[i + 1] ?? row;
    return row.map((value, j) => ((next[j] ?? value) - value) * rate_hz);
  });
}

/** Returns everything that can be drawn of a plan: the service's curves, or without them its own samples. */
export function quantitiesOf(plan: Plan, limits: JointLimits, curves: Curves | null): Quantity[] {
  return curves === null ? ownQuantities(plan, limits) : servedQuantities(curves);
}

function ownQuantities(plan: Plan, limits: JointLimits): Quantity[] {
  const trajectory = plan.trajectory;
  if (!trajectory) return [];
  const times = trajectory.time_from_start;
  const quantity = (key: string, label: string, unit: string, rows: readonly (readonly number[])[], bounds: Limit[]): Quantity => ({
    key, label, unit, check: key, times, steps: key === "joint_jerk", lines: joints(rows), limits: bounds,
  });
  const jerk = jerkOf(trajectory.accelerations, plan.sample_rate_hz);
  return [
    quantity("joint_position", "Position", "rad", trajectory.positions, positionLimits(limits)),
    quantity("joint_velocity", "Velocity", "rad/s", trajectory.velocities, symmetric(limits.velocity)),
    quantity("joint_acceleration", "Acceleration", "rad/s²", trajectory.accelerations, symmetric(limits.acceleration)),
    quantity("joint_jerk", "Jerk", "rad/s³", jerk, symmetric(limits.jerk)),
  ];
}

/** Labels of the curves, in the order in which they are offered. */
const LABELS: Readonly<Record<string, string>> = {
  joint_position: "Position",
  joint_velocity: "Velocity",
  joint_acceleration: "Acceleration",
  joint_jerk: "Jerk",
  joint_torque: "Torque",
  tcp_speed: "Tool speed",
  singularity_distance: "Singularity",
  self_collision: "Self-clearance",
  floor: "Floor",
  keep_out: "Surroundings",
  keep_in: "Kept in",
  flight_clearance: "Flight",
  grip_acceleration: "Grip",
  opening_direction: "Opening",
  elbow_speed: "Elbow speed",
  momentum: "Momentum",
  power: "Power",
  stopping_time: "Standstill time",
  stopping_distance: "Standstill distance",
};

/** Units as people write them. */
export function unitText(unit: string): string {
  return unit === "1" ? "–" : unit.replaceAll("^2", "²").replaceAll("^3", "³");
}

function lineLabel(name: string, index: number, count: number): string {
  return count === JOINTS.length && name.endsWith("_joint") ? (JOINTS[index] ?? name) : name.replaceAll("_", " ");
}

/** What the service computes with the certificate's own functions. */
function servedQuantities(curves: Curves): Quantity[] {
  const order = Object.keys(LABELS);
  const rank = (name: string): number => (order.includes(name) ? order.indexOf(name) : order.length);
  return curves.curves
    .filter((curve) => curve.series.length > 0)
    .map((curve) => ({
      key: curve.name,
      label: LABELS[curve.name] ?? curve.name.replaceAll("_", " "),
      unit: unitText(curve.unit),
      check: curve.name,
      times: (curve.clock === "flight" ? curves.time_from_start.flight : null) ?? curves.time_from_start.motion,
      steps: curve.holds_until_next,
      lines: curve.series.map(({ name, values }, i) => ({ label: lineLabel(name, i, curve.series.length), values })),
      limits: limitsOf(curve.series),
    }))
    .sort((a, b) => rank(a.key) - rank(b.key));
}

type Series = Curves["curves"][number]["series"];

/** Limits of the lines; one for all where they are alike. */
function limitsOf(series: Series): Limit[] {
  return (["lower", "upper"] as const).flatMap((side): Limit[] => {
    const values = series.map((line) => line[side]);
    const first = values[0];
    if (first !== null && first !== undefined && values.every((value) => value === first)) return [{ value: first, line: null }];
    return values.flatMap((value, line) => (value === null ? [] : [{ value, line }]));
  });
}

/** Share of its limit that is left, 0 at the limit: what the margin bars show. */
export function relativeMargin(check: Check): number | null {
  const { margin, limit, value } = check;
  if (margin === null || limit === null) return null;
  const scale = Math.max(Math.abs(limit), Math.abs(value ?? 0));
  return scale === 0 ? null : Math.max(0, Math.min(1, margin / scale));
}

/** How a value stands to its limit: a limit from below is told by its margin. */
export function relationOf({ value, limit, margin, ok }: Check): "≤" | "≥" | "<" | ">" {
  const fromBelow = value !== null && limit !== null && margin !== null && value !== limit && Math.sign(value - limit) === Math.sign(margin);
  if (ok) return fromBelow ? "≥" : "≤";
  return fromBelow ? "<" : ">";
}

/** Checks that hold by construction: their margin says nothing about how hard the plan works. */
export const FORMAL: ReadonlySet<string> = new Set(["start", "end_at_rest", "continuity", "release_position", "release_velocity", "landing"]);

/** Returns the check with the least margin: the limit that binds. */
export function bindingCheck(checks: readonly Check[]): Check | null {
  let binding: Check | null = null;
  for (const check of checks) {
    const margin = FORMAL.has(check.name) ? null : relativeMargin(check);
    if (margin !== null && (binding === null || margin < (relativeMargin(binding) ?? 1))) binding = check;
  }
  return binding;
}
