/** The motion between a trajectory's samples: one constant jerk a tick, as `planner.trajectory.Trajectory.at` has it. */

/** Samples of a joint motion, one a tick, in the field names of ROS `JointTrajectory`. */
export interface Samples {
  readonly positions: readonly (readonly number[])[]; // [rad]
  readonly velocities: readonly (readonly number[])[]; // [rad/s]
  readonly accelerations: readonly (readonly number[])[]; // [rad/s²]
}

/** State of the joints at one time. */
export interface JointState {
  readonly positions: number[]; // [rad]
  readonly velocities: number[]; // [rad/s]
  readonly accelerations: number[]; // [rad/s²]
}

/** Returns the time of the last sample [s]. */
export function durationOf(samples: Samples, sampleRateHz: number): number {
  return (samples.positions.length - 1) / sampleRateHz;
}

/** Returns the exact state at time `t` [s]; times outside the motion are clipped to it. */
export function stateAt(samples: Samples, sampleRateHz: number, t: number): JointState {
  const last = samples.positions.length - 1;
  const clipped = Math.min(Math.max(t, 0), last / sampleRateHz);
  const i = Math.max(0, Math.min(Math.floor(clipped * sampleRateHz), last - 1));
  const s = clipped - i / sampleRateHz;
  const [qdd, following] = [samples.accelerations[i]!, samples.accelerations[Math.min(i + 1, last)]!];
  const jerk = qdd.map((value, joint) => (following[joint]! - value) * sampleRateHz);
  return {
    positions: samples.positions[i]!.map((q, joint) => {
      return q + s * (samples.velocities[i]![joint]! + s * (qdd[joint]! / 2 + (s * jerk[joint]!) / 6));
    }),
    velocities: samples.velocities[i]!.map((qd, joint) => qd + s * (qdd[joint]! + (s * jerk[joint]!) / 2)),
    accelerations: qdd.map((value, joint) => value + s * jerk[joint]!),
  };
}

/** When a plan's arm rests and its object has landed [s]. */
export function endOf(plan: { duration_s: number; release_time_s: number | null; flight?: { time_of_flight_s: number } | null }): number {
  return Math.max(plan.duration_s, (plan.release_time_s ?? 0) + (plan.flight?.time_of_flight_s ?? 0));
}
