import { expect, test } from "vitest";
import { type Body, linesOf } from "../src/model/bodies";
import { poseOfRows, type Vector } from "../src/model/poses";

const TURNED = poseOfRows([
  [0, 0, 1, 1],
  [1, 0, 0, 2],
  [0, 1, 0, 3],
  [0, 0, 0, 1],
]); // its z is the world's x

function extremes(shape: Body["shape"], extent: Vector): [number, number][] {
  const points = linesOf({ name: "", shape, pose: TURNED, extent }).flat();
  return [0, 1, 2].map((axis) => [Math.min(...points.map((p) => p[axis]!)), Math.max(...points.map((p) => p[axis]!))]);
}

test.each([
  ["box", [0.2, 0.4, 0.6], [[0.7, 1.3], [1.9, 2.1], [2.8, 3.2]]],
  ["cylinder", [0.2, 0.2, 0.6], [[0.7, 1.3], [1.9, 2.1], [2.9, 3.1]]],
  ["sphere", [0.2, 0.2, 0.2], [[0.9, 1.1], [1.9, 2.1], [2.9, 3.1]]],
  ["capsule", [0.2, 0.2, 0.6], [[0.7, 1.3], [1.9, 2.1], [2.9, 3.1]]],
] as [Body["shape"], Vector, [number, number][]][])("the lines of a turned %s end where it does", (shape, extent, expected) => {
  extremes(shape, extent).forEach(([least, most], axis) => {
    expect(least).toBeCloseTo(expected[axis]![0], 9);
    expect(most).toBeCloseTo(expected[axis]![1], 9);
  });
});

test("a box has twelve edges, each once", () => {
  const edges = linesOf({ name: "", shape: "box", pose: TURNED, extent: [1, 2, 3] });
  const lengths = edges.map(([from, to]) => Math.hypot(...[0, 1, 2].map((i) => to![i]! - from![i]!)));
  expect(lengths.sort((a, b) => a - b).map((length) => Math.round(1e9 * length) / 1e9)).toEqual([1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3]);
});
