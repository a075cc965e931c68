/** A target that moves: where it is on a plan's clock. */

import type { Plan } from "../service/types";
import { type Pose, plus, scaled, transformed, type Vector } from "./poses";

interface AskedTarget {
  readonly kind?: string;
  readonly position?: readonly number[];
  readonly velocity?: readonly number[];
  readonly observed_at_s?: number | null;
  readonly opening?: { readonly radius_m: number; readonly rim_height_m: number } | null;
}
interface AskedMotion {
  readonly frame?: string | null;
  readonly release?: AskedTarget | null;
  readonly passages?: readonly { readonly state?: AskedTarget | null; readonly releases?: boolean | string | null }[] | null;
}

export class MovingTarget {
  readonly opening: { readonly radius_m: number; readonly rim_height_m: number } | null;

  private constructor(
    private readonly atStart: Vector, // as the motion begins [m]
    readonly velocity: Vector, // [m/s]
    asked: AskedTarget,
  ) {
    this.opening = asked.opening ?? null;
  }

  /** Returns the target of a plan; null where it stands, or where there is none. */
  static of(plan: Plan, base: Pose): MovingTarget | null {
    const { release, passages, frame } = plan.request as AskedMotion;
    const asked = release ?? passages?.find((passage) => passage.releases)?.state;
    const starts_s = plan.starts_at_s;
    if (!asked?.position || !asked.velocity || typeof asked.observed_at_s !== "number" || typeof starts_s !== "number") return null;
    const [seen, v] = [asked.position, asked.velocity] as unknown as [Vector, Vector];
    const atStart = plus(seen, v, starts_s - asked.observed_at_s);
    if (frame !== "base") return new MovingTarget(atStart, v, asked);
    return new MovingTarget(transformed(base, atStart), plus(transformed(base, v), scaled(transformed(base, [0, 0, 0]), -1)), asked);
  }

  /** Returns where it is at a time of the plan's clock [s]. */
  at(t: number): Vector {
    return plus(this.atStart, this.velocity, t);
  }
}
