import { describe, expect, it } from "vitest";
import { goodness, landingCellAt, pictureOfMap, requestOfMap } from "../src/model/throw-map";
import { tilesOf } from "../src/scene/floor-map";
import type { ThrowMap } from "../src/service/types";

const NONE = [[null, null, null], [null, null, null]];
// Two rows along y, three columns along x: hit soon, hit late, refused with proof / searched in vain, unknown, unknown.
const MAP: ThrowMap = {
  id: "m", cell: "c", plane_z_m: 0, planes_z_m: [0], robust: false, resolution_m: 0.1, origin: [1, -0.5], shape: [2, 3],
  state: "running", void_because: null, level_m: null, progress: { done: 4, total: 6 },
  values: {
    state: [[1, 1, 2], [3, 0, 0]],
    release_time_s: [[0.2, 0.4, null], [null, null, null]],
    landing_shift_10ms_m: NONE, hit_probability: [[0.3, 0.9, null], [null, null, null]], margin: NONE,
    reason: [[null, null, 0], [1, null, null]],
  },
  reasons: [{ constraint: "tcp_speed", text: "too fast" }, { constraint: "floor", text: "too low" }],
};

const pixel = (pixels: Uint8Array, n: number): number[] => [...pixels.slice(4 * n, 4 * n + 4)];

describe("picture of a map", () => {
  it("is bright where a throw is soon or sure", () => {
    const soon = pictureOfMap(MAP, "release_time_s");
    expect(soon.scale).toEqual([0.4, 0.2]);
    expect(pixel(soon.pixels, 0).slice(0, 3)).toEqual([...goodness(1)]);
    const sure = pictureOfMap(MAP, "hit_probability");
    expect(sure.scale).toEqual([0.3, 0.9]);
    expect(pixel(sure.pixels, 1).slice(0, 3)).toEqual([...goodness(1)]);
  });

  it("leaves out what is not known, and tells proven from searched in vain", () => {
    const { pixels } = pictureOfMap(MAP, "release_time_s");
    expect(pixel(pixels, 4)).toEqual([0, 0, 0, 0]);
    expect(pixel(pixels, 2)[3]).toBeGreaterThan(pixel(pixels, 3)[3]!);
  });

  it("names the reasons with their landing cells", () => {
    const { reasons } = pictureOfMap(MAP, "reason");
    expect(reasons.map(({ constraint, proven, vain }) => [constraint, proven, vain])).toEqual([["tcp_speed", 1, 0], ["floor", 0, 1]]);
  });

  it("shows coarse points as blocks until finer ones are known", () => {
    const coarse: ThrowMap = { ...MAP, level_m: 0.2, values: { ...MAP.values, state: [[1, 0, 1], [0, 0, 0]] } };
    const { pixels } = pictureOfMap(coarse, "release_time_s");
    expect(pixel(pixels, 3)).toEqual(pixel(pixels, 0)); // the row above
    expect(pixel(pixels, 5)).toEqual(pixel(pixels, 2));
    expect(pixel(pixels, 1)[3]).toBeGreaterThan(0);
  });
});

it("shows the first points as blocks before their level is complete", () => {
  const first: ThrowMap = { ...MAP, values: { ...MAP.values, state: [[0, 0, 1], [0, 0, 0]] } };
  const { pixels } = pictureOfMap(first, "reason");
  expect(pixel(pixels, 5)).toEqual(pixel(pixels, 2));
  expect(pixel(pixels, 3)[3]).toBe(0);
});

it("finds the landing cell about a point", () => {
  const near = (x: number, y: number): number[] | undefined => landingCellAt(MAP, x, y)?.map((value) => Number(value.toFixed(9)));
  expect(near(1.14, -0.46)).toEqual([1.1, -0.5]);
  expect(near(1.16, -0.36)).toEqual([1.2, -0.4]);
  expect(near(1.26, -0.5)).toBeUndefined();
  expect(near(0.94, -0.5)).toBeUndefined();
});

describe("a map that goes on", () => {
  const rounded = (values: readonly number[] | null | undefined): number[] | undefined => values?.map((value) => Number(value.toFixed(9)));
  it("is of the same extent, plane and kind of plans", () => {
    const { extent_m, ...rest } = requestOfMap({ ...MAP, plane_z_m: 0.7, planes_z_m: [0.7], robust: true });
    expect(rounded(extent_m)).toEqual([0.95, 1.25, -0.55, -0.35]);
    expect(rest).toEqual({ plane_z_m: 0.7, resolution_m: 0.1, robust: true });
  });
  it("is of the same volume", () => {
    const { volume_m, plane_z_m } = requestOfMap({ ...MAP, planes_z_m: [0, 0.1, 0.2] });
    expect([volume_m, plane_z_m]).toEqual([[0, 0.2], undefined]);
  });
});

it("is drawn for a paper as areas of equal landing cells", () => {
  const pixels = Uint8Array.from([[9, 8, 7, 255], [9, 8, 7, 255], [1, 2, 3, 51], [0, 0, 0, 0], [1, 2, 3, 51], [0, 0, 0, 0]].flat());
  const tiles = tilesOf({ lower: [1, -1], upper: [4, 1], z: 0.5, width: 3, height: 2, pixels });
  expect(tiles.map(({ corners }) => corners.map(([x, y]) => [x, y]))).toEqual([
    [[1, -1], [3, -1], [3, 0], [1, 0]],
    [[3, -1], [4, -1], [4, 0], [3, 0]],
    [[2, 0], [3, 0], [3, 1], [2, 1]],
  ]);
  expect(tiles.map(({ colour, opacity }) => [colour.getHexString(), opacity])).toEqual([["090807", 1], ["010203", 0.2], ["010203", 0.2]]);
});
