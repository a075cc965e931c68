// What the page says of a plan.

import { describe, expect, it } from "vitest";

import type { Plan } from "../src/service/types";
import { relationOf } from "../src/curves/quantities";
import type { CellState, CellSummary, Check } from "../src/service/types";
import { armKind, obstacleOf, sentence } from "../src/state/readiness";
import { adviceAfter, cancelledWords, cellWords, figure, foundWords, keyNumbers, length, metricRows, outcomeWords, plainWords, progressWords } from "../src/state/words";

function planWith(status: string): Plan {
  return { backend: "casadi", solver: { solve_time_s: 0.0234, status } } as Plan;
}

describe("what the page says of a search", () => {
  it("names back end and time", () => {
    expect(foundWords(planWith("fatrop: solved in 31 iterations"))).toBe("Found by casadi in 0.023 s.");
  });

  it("says what it has come to", () => {
    const begun = { stage: "queued", candidates: 0, best_release_time_s: null, elapsed_s: 0 } as const;
    expect(progressWords(begun)).toBe("Waiting for a planner, 0.0 s");
    expect(progressWords({ ...begun, stage: "search", candidates: 1, elapsed_s: 2.34 })).toBe("Searching: 1 candidate tried, nothing certified yet, 2.3 s");
    expect(progressWords({ ...begun, stage: "search", candidates: 3, best_release_time_s: 0.512 })).toContain("3 candidates tried, best release at 0.512 s");
    expect(progressWords({ ...begun, stage: "nearest", candidates: 5 })).toContain("Refused; looking for one that works: 5");
  });

  it("says what it had come to when it was cancelled", () => {
    const begun = { stage: "search", candidates: 2, best_release_time_s: null, elapsed_s: 3.52 } as const;
    expect(cancelledWords(begun)).toBe("Cancelled after 3.5 s: 2 candidates tried, nothing certified yet.");
    expect(cancelledWords({ ...begun, stage: "queued" })).toBe("Cancelled after 3.5 s, before the search began.");
    expect(cancelledWords({ ...begun, stage: "nearest" })).toContain("had been refused");
  });

  it("says that the time limit ended it", () => {
    const found = foundWords(planWith("fatrop: solved in 31 iterations; time_limit ended the search"));
    expect(found).toContain("Its time limit ended the search");
  });
});

describe("numbers", () => {
  it("that are rounding are none, and small ones have a power of ten", () => {
    expect([figure(5.09e-13), figure(-2e-12), length(5.09e-13)]).toEqual(["0", "0", "0 mm"]);
    expect([figure(3e-7), figure(-4.25e-5)]).toEqual(["3·10⁻⁷", "−4.25·10⁻⁵"]);
    expect(figure(0.0001)).toBe("0.0001");
  });
  it("beside their limit say on which side of it they are", () => {
    const check = (value: number, limit: number, margin: number): Check =>
      ({ name: "x", value, limit, margin, unit: "m", at_s: 0, ok: margin >= 0 });
    expect(relationOf(check(0.115, 0.05, 0.065))).toBe("≥"); // a distance to a singularity
    expect(relationOf(check(2.7, 3, 0.3))).toBe("≤");
    expect(relationOf(check(500, 500, 0))).toBe("≤");
    expect(relationOf(check(0.01, 0.02, -0.01))).toBe("<");
    expect(relationOf(check(3.5, 3, -0.5))).toBe(">");
  });
});

describe("names", () => {
  it("of joints and checks are people's, those of file keys stay", () => {
    expect(plainWords("shoulder_lift_joint leaves joint_position at 0.3 s")).toBe("shoulder leaves joint position at 0.3 s");
    expect(plainWords("13 ms late (timing.lag_s); landing_tolerance_m = 0.02")).toBe("13 ms late (timing.lag_s); landing_tolerance_m = 0.02");
  });
  it("of what was measured have units", () => {
    expect(metricRows({ tracking_error_max_rad: 0.0123, realtime: false, timing: {}, landing_error_m: null })).toEqual([
      ["Joint off the plan, at most", "12.3 mrad"],
      ["Real-time scheduling", "no"],
    ]);
  });
});

describe("what became of an execution", () => {
  const late = { outcome: "late", reason: "the gripper command was 12 ms late", metrics: { missed_ticks: 0, gripper_command_late_s: 0.012 } };
  it("says what was late", () => {
    expect(outcomeWords(late)).toBe("Thrown, but the gripper was told too late");
    expect(outcomeWords({ ...late, reason: "5 ticks lost so far, 5 in a row just now" })).toBe("Stopped: commands came too late");
    expect(keyNumbers(late as never, null, null)[2]).toEqual({ label: "Gripper command late", value: "12 ms", note: "" });
  });
  it("tells a machine that was too busy from a link that failed", () => {
    const silent = { outcome: "link_lost", reason: "the streaming process was silent for 102 ms" };
    expect(outcomeWords(silent)).not.toContain("Connection");
    expect(adviceAfter(silent.outcome, silent.reason)).toMatch(/^This machine was probably too busy: .*fling doctor/);
    expect(adviceAfter("link_lost", "no new state for 40 ms")).toMatch(/^Look at cable/);
    expect(adviceAfter("executor_lost", "the executor was frozen")).toContain("too busy");
    expect(adviceAfter("late", "5 ticks lost so far, 5 in a row just now: this machine was busy")).toContain("too busy");
    expect(adviceAfter("late", "5 ticks lost so far, 5 in a row just now: the link lost them")).toMatch(/^Look at cable/);
  });
  it("tells an object that was let go too early", () => {
    expect(outcomeWords({ outcome: "released_early" })).toBe("The object was let go too early");
  });
});

describe("a cell", () => {
  const summary = { name: "c", link_kind: "sim", link_host: "127.0.0.1", error: null } as CellSummary;
  const live = { executor: { alive: true, heartbeat_age_s: 0.1 }, robot: { refusals: [] }, fault: null, not_executable: null } as unknown as CellState;
  const circumstances = { lost: false, asksToken: false, summary, live };
  it("is simulated where its controller is on this machine", () => {
    expect(armKind(summary)).toBe("simulated");
    expect(armKind({ ...summary, link_host: "8.8.8.8" })).toBe("unproven");
    expect(armKind({ ...summary, link_kind: "ur" })).toBe("real");
    expect(cellWords({ ...summary, link_host: "8.8.8.8" }, live).tone).not.toBe("good");
    expect(cellWords(summary, live)).toMatchObject({ tone: "good", headline: "Ready" });
  });
  it("says why nothing can be thrown", () => {
    expect(obstacleOf(circumstances)).toBeNull();
    expect(obstacleOf({ ...circumstances, lost: true })).toBe("The service does not answer.");
    expect(obstacleOf({ ...circumstances, live: { ...live, not_executable: "a fault is latched" } })).toBe("A fault is latched.");
    expect(obstacleOf({ ...circumstances, live: { ...live, robot: { refusals: ["the arm is moving"] } } as never })).toBe("The arm is moving.");
    const latched = { ...live, fault: {}, not_executable: "a fault is latched: late; check the robot, then acknowledge it (`fling acknowledge`)" };
    expect(obstacleOf({ ...circumstances, live: latched as never })).toBe("A fault is latched: look at the arm, then acknowledge it above.");
    expect(sentence("`fling cell kinematics` reads it")).toBe("“fling cell kinematics” reads it.");
    expect(obstacleOf({ ...circumstances, live: null })).not.toBeNull();
  });
  it("has a silent executor, which may be stalled", () => {
    const silent = { ...live, executor: { ...live.executor, alive: false, heartbeat_age_s: 7.2 } } as CellState;
    const words = cellWords(summary, silent);
    expect(words.headline).toBe("The executor is silent");
    expect(words.reasons[0]).toContain("last heard of 7 s ago");
    const fault = { outcome: "executor_lost", reason: "the executor failed" };
    expect(cellWords(summary, { ...live, fault } as never).advice).toBe("See that the arm stands still, then acknowledge.");
    expect(cellWords(summary, { ...silent, fault } as never).advice).toContain("whether its process still runs");
  });
});
