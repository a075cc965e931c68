// Names for the documents of the service. They come from its OpenAPI schema: `make web` writes schema.d.ts.

import type { CheckAnswer, ExecutionAnswer, PlanAnswer, PlanRequest } from "./schema";

export type {
  CellList,
  CellModel,
  CellState,
  CellSummary,
  ExecutionAnswer as Execution,
  ExecutionList,
  LandingAnswer,
  LandingList,
  LandingRequest,
  PlanCurves as Curves,
  PlanRequest,
  ProfileList,
  ProfileSummary,
} from "./schema";

export type Plan = PlanAnswer;
export type Check = CheckAnswer;
export type Outcome = NonNullable<ExecutionAnswer["outcome"]>;

interface Violation {
  readonly constraint: string;
  readonly value: number | null;
  readonly limit: number | null;
  readonly unit: string;
  readonly detail?: string;
  readonly proven?: boolean;
}

/** The nearest feasible request: complete, ready to be posted. */
export type Nearest = PlanRequest;

export interface ProblemDocument {
  readonly type: string;
  readonly title: string;
  readonly status: number;
  readonly detail: string;
  readonly errors?: readonly { readonly field: string; readonly reason: string }[] | null;
  readonly violations?: readonly Violation[] | null;
  readonly nearest?: Nearest | null;
}

type Plane<T> = readonly (readonly T[])[]; // rows along y, then along x

/** One plane of a throwability map: `GET /cells/{name}/map`. */
export interface ThrowMap {
  readonly id: string;
  readonly cell: string;
  readonly cell_version: number | null;
  readonly profile: string | null;
  readonly plane_z_m: number;
  readonly resolution_m: number;
  readonly origin: readonly [number, number]; // centre of the landing cell with the least x and y [m]
  readonly shape: readonly [number, number]; // landing cells along y, along x
  readonly state: "running" | "finished" | "cancelled" | "void";
  readonly void_because: string | null;
  readonly level_m: number | null; // of the finest level that is complete
  readonly progress: { readonly done: number; readonly total: number };
  readonly values: {
    readonly state: Plane<number>; // 0 unknown, 1 yes, 2 refused with proof, 3 searched for in vain
    readonly release_time_s: Plane<number | null>;
    readonly landing_shift_10ms_m: Plane<number | null>;
    readonly hit_probability: Plane<number | null>;
    readonly margin: Plane<number | null>;
    readonly reason: Plane<number | null>; // index into `reasons`
  };
  readonly reasons: readonly { readonly constraint: string; readonly text: string }[];
}
