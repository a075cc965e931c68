import { describe, expect, it } from "vitest";
import { InvalidDraft } from "../src/state/numbers";
import { doubtfulDistance, newestResult, placeReport, resultReport, targetRadius } from "../src/state/landing-report";
import { offsetFrom } from "../src/state/scatter";
import { landingWords } from "../src/state/words";
import type { LandingAnswer, Plan } from "../src/service/types";

const kept = (fields: Partial<LandingAnswer>): LandingAnswer => ({
  id: "1", execution_id: "2", at: "", source: "person", reported_by: "", position: null, std_m: null, result: null, radius_m: null, ...fields,
});
const plan = (release: unknown): Plan => ({ request: { release } }) as unknown as Plan;

describe("a report of a landing", () => {
  it("is a place with its uncertainty, or a result with its radius, never both", () => {
    expect(placeReport(["1.21", "0,29", "0"], "0.005")).toEqual({ position: [1.21, 0.29, 0], std_m: 0.005, source: "person" });
    expect(resultReport("edge", "0.12")).toEqual({ result: "edge", radius_m: 0.12, source: "person" });
  });

  it("names the text that is no number", () => {
    expect(() => placeReport(["1", "", "0"], "0.01")).toThrow("landing 2: a number is needed");
    expect(() => placeReport(["1", "2", "0"], "little")).toThrow(new InvalidDraft("uncertainty", "little"));
    expect(() => resultReport("hit", "wide")).toThrow('radius: "wide" is not a number');
  });

  it("is about the bin's mouth where there is one, and about no radius without a target", () => {
    expect(targetRadius(plan({ kind: "target", opening: { radius_m: 0.12, rim_height_m: 0.2 } }))).toBe("0.12");
    expect(targetRadius(plan({ kind: "target" }))).toBe("0.1");
    expect(targetRadius(plan({ kind: "joint" }))).toBeNull();
    expect(targetRadius(null)).toBeNull();
  });

  it("reads as what was seen", () => {
    expect(landingWords(kept({ position: [1.21, -0.29, 0], std_m: 0.005 }))).toBe("at (1.21, −0.29, 0) ± 5 mm");
    expect(landingWords(kept({ position: [1.2, 0.3, 0], std_m: 0 }))).toBe("at (1.2, 0.3, 0)");
    expect(landingWords(kept({ result: "miss", radius_m: 0.1 }))).toBe("miss, beyond the target’s 100 mm");
  });

  it("says nothing about a place where it says whether the target was hit", () => {
    const list = [kept({ position: [1.21, 0.3, 0] }), kept({ result: "hit", radius_m: 0.1 }), kept({ result: "edge", radius_m: 0.05 })];
    expect(newestResult(list)?.result).toBe("edge");
    expect(newestResult(list.slice(0, 1))).toBeNull();
    expect(offsetFrom([1.2, 0.3, 0], list)?.[0]).toBeCloseTo(0.01, 12);
    expect(offsetFrom([1.2, 0.3, 0], list.slice(1))).toBeNull();
  });
});

describe("a report that is likely a slip", () => {
  const plan = { flight: { landing_point: [1.2, 0.3, 0] } } as unknown as Plan;
  it("is one far from where the throw was to land", () => {
    expect(doubtfulDistance(placeReport(["9", "9", "9"], "0.01"), plan)).toBeCloseTo(Math.hypot(7.8, 8.7, 9));
    expect(doubtfulDistance(placeReport(["1.4", "0.2", "0"], "0.01"), plan)).toBeNull();
    expect(doubtfulDistance(resultReport("miss", "0.1"), plan)).toBeNull();
    expect(doubtfulDistance(placeReport(["9", "9", "9"], "0.01"), null)).toBeNull();
  });
  it("counts nowhere once it is withdrawn", () => {
    const list = [kept({ position: [1.21, 0.3, 0] }), kept({ position: [9, 9, 9], withdrawn_at: "2026-11-28T00:00:00Z" })];
    expect(offsetFrom([1.2, 0.3, 0], list)?.[0]).toBeCloseTo(0.01, 12);
  });
});
