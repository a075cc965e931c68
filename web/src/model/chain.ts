/**
 * Forward kinematics of an arm, published or calibrated: X_i = X_(i-1) Rz(q_i) M_i, as `planner.kinematics` has it.
 *
 * M_i is Tz(d) Tx(a) Rx(alpha) of the published table, or the transform that the arm's calibration measured.
 */

import { axisOf, cross, type Pose, plus, positionOf, times, turnedAboutZ, type Vector } from "./poses";

export const JOINTS = 6;

/** The kinematic chain of a cell. */
export interface Chain {
  readonly base: Pose; // X_WB, the arm's base in the world
  readonly transforms: readonly Pose[]; // M_1 … M_6
  readonly tool: Pose; // X_FT, the tool centre point in the flange
}

/** Returns the poses in the world of the base and the six links, for joint positions [rad]. */
export function linkPoses(chain: Chain, q: ArrayLike<number>): Pose[] {
  const poses = [chain.base];
  chain.transforms.forEach((M, i) => poses.push(times(turnedAboutZ(poses[i]!, q[i]!), M)));
  return poses;
}

/** Returns the pose of the tool in the world, for joint positions [rad]. */
export function toolPose(chain: Chain, q: ArrayLike<number>): Pose {
  return times(linkPoses(chain, q)[JOINTS]!, chain.tool);
}

/** Pose and velocity of the tool centre point in the world. */
interface ToolState {
  readonly pose: Pose;
  readonly velocity: Vector; // [m/s]
}

/** Returns pose and velocity of the tool: each joint turns it about its axis, v = sum of qd_i z_i × (p - o_i). */
export function toolState(chain: Chain, q: ArrayLike<number>, qd: ArrayLike<number>): ToolState {
  const links = linkPoses(chain, q);
  const pose = times(links[JOINTS]!, chain.tool);
  const p = positionOf(pose);
  let velocity: Vector = [0, 0, 0];
  for (let i = 0; i < JOINTS; i++) {
    velocity = plus(velocity, cross(axisOf(links[i]!, 2), plus(p, positionOf(links[i]!), -1)), qd[i]!);
  }
  return { pose, velocity };
}
