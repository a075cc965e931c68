/** What the camera is to show of a cell, its plan and what was asked for. Pure. */

import type { CellGeometry } from "../model/cell";
import { linkPoses } from "../model/chain";
import { plus, positionOf, type Vector } from "../model/poses";
import { directionTo, type Subject } from "./camera";
import type { PlanMotion } from "./plan";

const ROUND_M = 0.12; // [m] about each joint: the arm is as thick

/** Returns the subject of a view: the arm's postures, the throw, and further points. */
export function subjectOf(cell: CellGeometry, motion: PlanMotion | null, q: readonly number[], landing: Vector | null, others: readonly Vector[]): Subject {
  const base = positionOf(cell.chain.base);
  const postures = motion ? [0, motion.releaseTime, motion.duration].map((t) => motion.at(t).positions) : [q];
  const joints = postures.flatMap((posture) => linkPoses(cell.chain, posture).map(positionOf));
  const around = [ROUND_M, -ROUND_M].flatMap((r) => joints.map((point) => plus(point, [r, r, r])));
  const marks = landing ? [plus(landing, [0.1, 0.1, 0]), plus(landing, [-0.1, -0.1, 0])] : [];
  const points = [base, ...around, ...marks, ...others, ...(motion?.extent() ?? [])];
  return { points, base, direction: directionTo(base, landing ?? plus(base, [0.001, -1, 0])), landing };
}
