// Names for the documents of the service. They come from its OpenAPI schema: `make web` writes schema.d.ts.

import type { PlanAnswer } from "./schema";

export type {
  CellList,
  CellState,
  CellSummary,
  CheckAnswer,
  ExecutionAnswer as Execution,
  LandingAnswer,
  LandingRequest,
  PlanRequest,
  ProfileList,
  ProfileSummary,
} from "./schema";

export type Plan = PlanAnswer;
export type ReleaseRequest = import("./schema").PlanRequest["release"];

/** Answer of GET /cells/{name}/model. Provisional until the service's schema has it. */
export type CellModel = any;
/** Answer of GET /plans/{id}/curves. Provisional until the service's schema has it. */
export type Curves = any;
