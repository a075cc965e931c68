// Axes of the charts: their numbers, their range, and the part of the time that is shown.

import { describe, expect, it } from "vitest";

import { axisRange, tickTexts } from "../src/curves/ticks";
import { spanOf, zoom } from "../src/curves/zoom";

describe("the numbers along an axis", () => {
  it("are told apart", () => {
    expect(tickTexts([-4e-7, -2e-7, 0, 2e-7])).toEqual(["−0.0000004", "−0.0000002", "0.0000000", "0.0000002"]);
    expect(tickTexts([0, 0.05, 0.1])).toEqual(["0.00", "0.05", "0.10"]);
    expect(tickTexts([-500, 0, 500])).toEqual(["−500", "0", "500"]);
    expect(tickTexts([0, 0.25, 0.5, 0.75])).toEqual(["0.00", "0.25", "0.50", "0.75"]);
    expect(tickTexts([0.0935, 0.09375, 0.094])).toEqual(["0.09350", "0.09375", "0.09400"]);
  });
  it("have no zero with a sign", () => {
    expect(tickTexts([-0.5, -1e-17, 0.5])).toEqual(["−0.5", "0.0", "0.5"]);
  });
});

describe("the range of an axis", () => {
  it("does not magnify rounding", () => {
    const [low, high] = axisRange([1e-17, -2e-17, 0], []);
    expect(high - low).toBeGreaterThan(1e-3);
    expect(axisRange([], [])).toEqual([0, 1]);
  });
  it("holds limits that are near", () => {
    expect(axisRange([0, 2], [3, 90])[1]).toBeGreaterThan(3);
    expect(axisRange([0, 2], [3, 90])[1]).toBeLessThan(4);
  });
});

describe("the time that is shown", () => {
  it("is all of it, or what was chosen", () => {
    expect(spanOf(null, 1.04, 0.3)).toEqual([0, 1.04]);
    expect(spanOf(null, 0, 0)).toEqual([0, 1]);
    expect(spanOf([0.2, 0.4], 1, 0.3)).toEqual([0.2, 0.4]);
  });
  it("goes along with the cursor", () => {
    expect(spanOf([0.2, 0.4], 1, 0.5)[1]).toBeCloseTo(0.5);
    expect(spanOf([0.2, 0.4], 1, 0.1)[0]).toBeCloseTo(0.1);
  });
  it("is zoomed about an instant, within the plan", () => {
    expect(zoom([0, 1], 0.5, 0.5, 1)).toEqual([0.25, 0.75]);
    expect(zoom([0.25, 0.75], 4, 0.5, 1)).toBeNull();
    expect(zoom([0, 1], 0.5, 0, 1)).toEqual([0, 0.5]);
    const narrow = zoom([0, 0.03], 0.1, 0.01, 1)!;
    expect(narrow[1] - narrow[0]).toBeCloseTo(0.02); // ten ticks
  });
});
