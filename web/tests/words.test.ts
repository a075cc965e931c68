// What the page says of a plan.

import { describe, expect, it } from "vitest";

import type { Plan } from "../src/service/types";
import { foundWords } from "../src/state/words";

function planWith(status: string): Plan {
  return { backend: "casadi", solver: { solve_time_s: 0.0234, status } } as Plan;
}

describe("what the page says of a search", () => {
  it("names back end and time", () => {
    expect(foundWords(planWith("fatrop: solved in 31 iterations"))).toBe("Found by casadi in 0.023 s.");
  });

  it("says that the time limit ended it", () => {
    const found = foundWords(planWith("fatrop: solved in 31 iterations; time_limit ended the search"));
    expect(found).toContain("Its time limit ended the search");
  });
});
