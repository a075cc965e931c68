// Names for the documents of the service. They come from its OpenAPI schema: `make web` writes schema.d.ts.

import type { CheckAnswer, ExecuteRequest, ExecutionAnswer, MapAnswer, PlanAnswer, PlanRequest } from "./schema";

export type {
  CalibrationMoves,
  CellList,
  CellModel,
  CellState,
  CellSummary,
  ExecutionAnswer as Execution,
  ExecutionList,
  JobAnswer as Job,
  JobList,
  LandingAnswer,
  LandingList,
  LandingRequest,
  MapBody as MapRequest,
  ObjectResult,
  ObjectResultList,
  PassageRequest,
  PlanCurves as Curves,
  PlanProgress,
  PlanRequest,
  ProfileList,
  ProfileSummary,
  TimingAnswer,
} from "./schema";

export type Plan = PlanAnswer;
export type Check = CheckAnswer;
export type ExecutionMode = NonNullable<ExecuteRequest["mode"]>;
export type Outcome = NonNullable<ExecutionAnswer["outcome"]>;

interface Violation {
  readonly constraint: string;
  readonly value: number | null;
  readonly limit: number | null;
  readonly unit: string;
  readonly detail?: string;
  readonly proven?: boolean;
}

/** A feasible request near the refused one: complete, ready to be posted. */
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

type Read = "id" | "cell" | "plane_z_m" | "planes_z_m" | "robust" | "resolution_m" | "state" | "void_because" | "level_m" | "progress" | "values" | "reasons";

/** One plane of a throwability map, as far as it is read here. */
export interface ThrowMap extends Pick<MapAnswer, Read> {
  readonly origin: readonly [number, number]; // centre of the landing cell with the least x and y [m]
  readonly shape: readonly [number, number]; // landing cells along y, along x
}
