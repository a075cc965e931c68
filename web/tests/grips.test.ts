// What a pointer takes hold of: seen from above never the height.

import { describe, expect, it } from "vitest";

import { targetGrip } from "../src/scene/grips";

const MIDDLE = [500, 300] as const;
const FROM_ABOVE = [0, 0.001, -1] as const;
const FROM_ASIDE = [0, 0.9, -0.43] as const;

describe("the target", () => {
  it("is dragged over the floor when it is seen from above, wherever it is taken", () => {
    for (const tip of [[500, 300], [506, 297], [560, 280]] as const) {
      for (const pointer of [MIDDLE, tip, [504, 298]] as const) expect(targetGrip(pointer, MIDDLE, tip, FROM_ABOVE, true)).toBe("floor");
    }
  });
  it("is lifted by its arrow, and by nothing else", () => {
    const tip = [500, 220] as const;
    expect(targetGrip([500, 222], MIDDLE, tip, FROM_ASIDE, false)).toBe("lift");
    expect(targetGrip([501, 299], MIDDLE, tip, FROM_ASIDE, true)).toBe("floor");
    expect(targetGrip([540, 299], MIDDLE, tip, FROM_ASIDE, false)).toBeNull();
  });
  it("is not lifted by an arrow too short to be told from what it stands on", () => {
    expect(targetGrip([500, 280], MIDDLE, [500, 275], FROM_ASIDE, true)).toBe("floor");
  });
});
