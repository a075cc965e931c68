// The guided calibration: which step is next, what counts, and what a reload brings back.

import { beforeEach, describe, expect, it, vi } from "vitest";

import type { CalibrationMoves, Execution } from "../src/service/types";
import { begun, type Calibration, candidates, ended, keep, kept, moveWords, next, THROWS } from "../src/state/calibration";

const MOVES = {
  cell: "ur5e-sim", amplitude_rad: 0.25, reach_m: [1, 1.5], motions: [[{ a: 0.25 }, { a: 0.125 }], [{ b: 0.25 }]], throws: [{ t: 0 }, { t: 1 }, { t: 2 }],
} as unknown as CalibrationMoves;

const run = (id: string, fields: Partial<Execution> = {}): Execution =>
  ({ id, plan_id: `plan-${id}`, state: "finished", outcome: "completed", metrics: { timing: { lag_s: 0.02 } }, ...fields }) as Execution;

/** After so many moves that were completed. */
function after(now: Calibration, moves: number, wanted: number): Calibration {
  let last = now;
  for (let i = 0; i < moves; i += 1) last = ended({ ...last, running: `e${i}` }, run(`e${i}`), wanted, "");
  return last;
}

describe("the steps", () => {
  it("are motions, their lag, throws, and the profile", () => {
    const moved = after(begun("ur5e-sim", null), 2, 2);
    expect([moved.step, moved.motions.map((move) => move.lag_s)]).toEqual(["lag", [0.02, 0.02]]);
    const thrown = after(next({ ...moved, profile: "p1" }), THROWS, THROWS);
    expect([thrown.step, thrown.profile, thrown.running]).toEqual(["profile", null, null]);
    const done = next({ ...thrown, profile: "p2" });
    expect([done.step, done.profile]).toEqual(["done", "p2"]);
    expect(next(done).step).toBe("done");
  });
  it("stay where they are after a move that was not completed, with what was found", () => {
    const one = after(begun("ur5e-sim", null), 1, 4);
    const stopped = ended({ ...one, running: "e9" }, run("e9", { outcome: "aborted" }), 4, "Motion 2 of 4: stopped.");
    expect([stopped.step, stopped.motions.length, stopped.running, stopped.trouble]).toEqual(["motions", 1, null, "Motion 2 of 4: stopped."]);
    expect(moveWords(stopped, 4)).toBe("Motion 2 of 4");
    expect(ended({ ...stopped, running: "e10" }, run("e10"), 4, "").trouble).toBeNull();
  });
  it("count a motion that shows no lag as one without", () => {
    expect(ended(begun("ur5e-sim", null), run("e", { metrics: { timing: null } as Execution["metrics"] }), 4, "").motions[0]?.lag_s).toBeNull();
  });
});

describe("what moves next", () => {
  it("is the longest motion that is not refused", () => {
    const first = begun("ur5e-sim", null);
    expect(candidates(first, MOVES)).toEqual([{ a: 0.25 }, { a: 0.125 }]);
    expect(candidates(after(first, 1, 4), MOVES)).toEqual([{ b: 0.25 }]);
  });
  it("is a throw like none before it, thrown or refused", () => {
    expect(candidates({ ...begun("ur5e-sim", null), step: "throws", tried: 1 }, MOVES)).toEqual([{ t: 1 }, { t: 2 }]);
  });
});

describe("a reload", () => {
  beforeEach(() => {
    const storage = new Map<string, string>();
    vi.stubGlobal("sessionStorage", {
      getItem: (key: string) => storage.get(key) ?? null,
      setItem: (key: string, value: string) => storage.set(key, value),
      removeItem: (key: string) => storage.delete(key),
    });
  });
  it("brings back what was found and what runs", () => {
    const now = { ...after(begun("ur5e-sim", "p0"), 3, 4), running: "e3" };
    keep(now);
    expect(kept()).toEqual(now);
    keep(null);
    expect(kept()).toBeNull();
  });
  it("begins afresh where what was kept cannot be read", () => {
    sessionStorage.setItem("fling-calibration", "{");
    expect(kept()).toBeNull();
  });
});
