import { expect, test } from "vitest";

import { curveDrawing } from "../src/curves/drawing";
import type { Quantity } from "../src/curves/quantities";
import { flagsOf, mainState, mainTime } from "../src/model/passages";
import { endOf } from "../src/model/samples";
import type { Plan } from "../src/service/types";
import { planWords } from "../src/state/words";

const edge = (index: number, level: boolean, edge_time_s: number) => ({
  output: "standard_digital", index, level, offset_s: 0, command_time_s: edge_time_s - 0.02, edge_time_s,
});
const passed = (name: string, time_s: number, outputs: ReturnType<typeof edge>[]) => ({ name, time_s, index: time_s * 500, outputs });
const ROW = {
  duration_s: 2,
  release_time_s: null,
  release: null,
  flight: null,
  passages: [passed("part 0", 0.5, [edge(0, true, 0.5), edge(0, false, 0.52)]), passed("part 1", 0.9, [edge(1, true, 0.85)])],
} as unknown as Plan;
const THROW = { duration_s: 1, release_time_s: 0.4, release: { index: 200 }, flight: { time_of_flight_s: 0.7, speed_m_s: 2 } } as unknown as Plan;

test("what happens in passing stands on the time line in its order", () => {
  expect(flagsOf(ROW).map(({ at_s, text, level }) => [at_s, text, level])).toEqual([
    [0.5, "part 0", null],
    [0.5, "standard digital 0 on", true],
    [0.52, "standard digital 0 off", false],
    [0.85, "standard digital 1 on", true],
    [0.9, "part 1", null],
  ]);
});

test("a line has a flag at its end, too", () => {
  const bead = { ...ROW.passages![1]!, name: "bead", end_index: 650 };
  const plan = { ...ROW, sample_rate_hz: 500, passages: [bead] } as Plan;
  expect(flagsOf(plan).map(({ at_s, text }) => [at_s, text])).toEqual([
    [0.85, "standard digital 1 on"],
    [0.9, "bead"],
    [1.3, "bead ends"],
  ]);
});

test("a release is the only flag of a throw, and a move to rest has none", () => {
  expect(flagsOf(THROW)).toEqual([{ at_s: 0.4, text: "release", level: null }]);
  expect(flagsOf({ ...THROW, flight: null })).toEqual([]);
});

test("without a release the last passage stands for it", () => {
  expect(mainTime(ROW)).toBe(0.9);
  expect(mainState(ROW)).toBe(ROW.passages![1]);
  expect(endOf(ROW)).toBe(2);
  expect(mainState(THROW)).toBe(THROW.release);
  expect(endOf(THROW)).toBeCloseTo(1.1);
});

test("a plan of passages says what it passes", () => {
  expect(planWords(ROW)).toBe("Passes part 0 after 0.50 s, part 1 after 0.90 s; at rest after 2.00 s. Nothing flies.");
});

test("a drawing of curves has a line a passage and a pennant an edge", () => {
  const quantity = { label: "q", unit: "rad", times: [0, 2], lines: [{ label: "a", values: [0, 1] }], limits: [] } as unknown as Quantity;
  const svg = curveDrawing(quantity, flagsOf(ROW));
  expect(svg).toContain(">part 0</text>");
  expect(svg.match(/<title>standard digital/g)).toHaveLength(3);
});
