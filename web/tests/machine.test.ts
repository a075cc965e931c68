// The state machine: what may be thrown, and what is shown as running.

import { describe, expect, it } from "vitest";

import type { Execution, Plan, ProblemDocument } from "../src/service/types";
import { FIRST_DRAFT } from "../src/state/draft";
import {
  type Change, change, FIRST_STATE, isArmed, isRunning, PHASES, planStanding, type Run, type State, throwLabel, wentThrough,
} from "../src/state/machine";
import { against, keyNumbers, outcomeWords } from "../src/state/words";

const PLAN = {
  id: "p1", cell: "ur5e-sim", request: { release: { kind: "target", position: [1.2, 0.3, 0] } }, flight: { landing_point: [1.2, 0.3, 0], speed_m_s: 3.62 },
} as unknown as Plan;
const PROBLEM: ProblemDocument = { type: "/problems/infeasible", title: "The arm cannot do this", status: 422, detail: "too far" };
const execution = (fields: Partial<Execution>): Execution =>
  ({ id: "e1", plan_id: "p1", cell: "ur5e-sim", state: "queued", outcome: null, reason: null, metrics: null, abort_requested_at: null, ...fields }) as Execution;

function after(...changes: Change[]): State {
  return changes.reduce(change, FIRST_STATE);
}

const CHOSEN: Change = { type: "cell", name: "ur5e-sim" };
const PLANNED: readonly Change[] = [CHOSEN, { type: "ask" }, { type: "planned", revision: 1, plan: PLAN }];
const EDIT: Change = { type: "edit", request: { ...FIRST_DRAFT, target: ["1.3", "0.3", "0"] } };

describe("what may be thrown", () => {
  it("is a plan that answers the request on the screen", () => {
    expect(isArmed(after(...PLANNED))).toBe(true);
    expect(planStanding(after(...PLANNED))).toBe("valid");
  });
  it("is nothing after an edit, even one that is taken back", () => {
    expect(planStanding(after(...PLANNED, EDIT))).toBe("stale");
    expect(isArmed(after(...PLANNED, EDIT))).toBe(false);
    expect(isArmed(after(...PLANNED, EDIT, { type: "edit", request: FIRST_DRAFT }))).toBe(false);
  });
  it("is nothing on another cell, nor after coming back from it", () => {
    const away = after(...PLANNED, { type: "cell", name: "ur10e-sim" });
    expect(isArmed(away)).toBe(false);
    expect(isArmed(change(away, CHOSEN))).toBe(false);
  });
  it("is nothing that was edited while it was planned", () => {
    const late = after(CHOSEN, { type: "ask" }, EDIT, { type: "planned", revision: 1, plan: PLAN });
    expect(planStanding(late)).toBe("stale");
    expect(isArmed(late)).toBe(false);
  });
  it("is nothing while a preview is shown, or while something runs", () => {
    expect(isArmed(after(...PLANNED, { type: "preview", plan: PLAN }))).toBe(false);
    const running = after(...PLANNED, { type: "runs", cell: "ur5e-sim", id: "e1" });
    expect(isRunning(running)).toBe(true);
    expect(isArmed(running)).toBe(false);
    expect(isArmed(change(running, { type: "execution", execution: execution({ state: "finished", outcome: "completed" }) }))).toBe(true);
  });
  it("is named by cell and place", () => {
    expect(throwLabel(PLAN, 0)).toBe("Throw on ur5e-sim to (1.20, 0.30)");
    expect(throwLabel(null, 0)).toBe("Throw");
  });
  it("is named by its height, too, unless that is the floor's", () => {
    const above = { ...PLAN, request: { release: { kind: "target", position: [1.2, -0.001, 0.789] } } } as unknown as Plan;
    expect(throwLabel(above, 0)).toBe("Throw on ur5e-sim to (1.20, 0.00, 0.79)");
    expect(throwLabel(PLAN, -0.8)).toBe("Throw on ur5e-sim to (1.20, 0.30, 0.00)");
    expect(throwLabel(PLAN, null)).toBe("Throw on ur5e-sim to (1.20, 0.30, 0.00)"); // not known yet
  });
});

describe("a refusal", () => {
  it("belongs to the request that was refused", () => {
    expect(after(CHOSEN, { type: "ask" }, { type: "refused", revision: 1, problem: PROBLEM }).problem?.value).toBe(PROBLEM);
    expect(after(CHOSEN, { type: "ask" }, EDIT, { type: "refused", revision: 1, problem: PROBLEM }).problem).toBeNull();
    expect(after(CHOSEN, { type: "ask" }, { type: "refused", revision: 1, problem: PROBLEM }, EDIT).problem).toBeNull();
  });
  it("tells value and limit apart, however close", () => {
    expect(against(1.8942, 1.8931, "m/s")).toBe("1.894 m/s against a limit of 1.893 m/s");
    expect(against(3.5, 3, "rad/s")).toBe("3.5 rad/s against a limit of 3 rad/s");
  });
  it("ends the planning", () => {
    expect(after(CHOSEN, { type: "ask" }, { type: "refused", revision: 1, problem: PROBLEM }).planning).toBeNull();
    expect(after(CHOSEN, { type: "ask" }, { type: "gave-up", revision: 1 }).planning).toBeNull();
  });
});

describe("the execution", () => {
  it("is the chosen cell's, whoever started it", () => {
    expect(after(CHOSEN, { type: "runs", cell: "ur5e-sim", id: "e9" }).execution?.id).toBe("e9");
    expect(after(CHOSEN, { type: "runs", cell: "ur10e-sim", id: "e9" }).execution).toBeNull();
    expect(after(CHOSEN, { type: "execution", execution: execution({ cell: "ur10e-sim" }) }).execution).toBeNull();
  });
  it("collects telemetry and keeps it when its document is read again", () => {
    const sample = { clock_s: 0.1, positions: [1, 2, 3, 4, 5, 6], planned_positions: [1, 2, 3, 4, 5, 6], missed_ticks: 2 };
    const seen = after(CHOSEN, { type: "runs", cell: "ur5e-sim", id: "e1" }, { type: "event", id: "e1", kind: "telemetry", data: sample });
    expect(seen.execution?.samples).toHaveLength(1);
    expect(change(seen, { type: "execution", execution: execution({ state: "finished" }) }).execution?.samples[0]?.clock_s).toBe(0.1);
    expect(change(seen, { type: "event", id: "e2", kind: "telemetry", data: sample }).execution?.samples).toHaveLength(1);
  });
  it("never goes back: an answer may be older than an event, or of the throw before", () => {
    const run = after(
      CHOSEN, { type: "runs", cell: "ur5e-sim", id: "e1" }, { type: "event", id: "e1", kind: "state", data: { state: "approaching" } },
    );
    expect(change(run, { type: "execution", execution: execution({ state: "preparing" }) }).execution?.state).toBe("approaching");
    expect(change(run, { type: "execution", execution: execution({ id: "e0", state: "finished" }) }).execution?.id).toBe("e1");
    expect(change(run, { type: "execution", execution: execution({ state: "finished" }) }).execution?.state).toBe("finished");
  });
  it("went through no more phases than were seen, unless it let go of its object", () => {
    const run = after(
      CHOSEN, { type: "runs", cell: "ur5e-sim", id: "e1" }, { type: "event", id: "e1", kind: "state", data: { state: "approaching" } },
    );
    const braked = change(run, { type: "event", id: "e1", kind: "state", data: { state: "braking" } });
    const ended = (metrics: Record<string, unknown>): Run =>
      change(braked, { type: "event", id: "e1", kind: "state", data: { state: "finished", outcome: "aborted", metrics } }).execution!;
    expect(PHASES.filter((phase) => wentThrough(phase, braked.execution!))).toEqual(["queued", "preparing", "approaching"]);
    expect(PHASES.filter((phase) => !wentThrough(phase, ended({ released: false })))).toEqual(["streaming"]);
    const past = after(CHOSEN, { type: "execution", execution: execution({ state: "finished", outcome: "aborted" }) }).execution!;
    expect(PHASES.filter((phase) => wentThrough(phase, past))).toEqual(["finished"]); // nobody saw the others
    expect(PHASES.every((phase) => wentThrough(phase, ended({ released: true })))).toBe(true);
    expect(keyNumbers(ended({ released: false }), null, PLAN)[1]?.value).toBe("–");
    expect(keyNumbers(ended({ released: true }), null, PLAN)[1]?.value).toBe("3.62 m/s");
    expect(outcomeWords({ outcome: "completed", metrics: { released: false } })).toBe("Moved as planned");
    expect(outcomeWords({ outcome: "completed", metrics: { released: true } })).toBe("Thrown as planned");
    expect(outcomeWords({ outcome: "completed", metrics: { released: false }, dryRun: true })).toBe("Dry run: nothing moved");
    expect(outcomeWords({ outcome: "aborted", dryRun: true })).toBe("Dry run: stopped on request");
  });
  it("is marked as being stopped, also by somebody else", () => {
    const run = after(CHOSEN, { type: "runs", cell: "ur5e-sim", id: "e1" });
    expect(change(run, { type: "stopping", id: "e1" }).execution?.stopping).toBe(true);
    expect(change(run, { type: "execution", execution: execution({ abort_requested_at: "2026-01-01T00:00:00Z" }) }).execution?.stopping).toBe(true);
  });
});
