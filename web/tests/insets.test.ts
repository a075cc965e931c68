// What panels leave free of the scene, beside it and on a phone.

import { describe, expect, it } from "vitest";

import { insetsFrom } from "../src/scene/insets";

const box = (left: number, top: number, right: number, bottom: number): { left: number; top: number; right: number; bottom: number } => ({ left, top, right, bottom });

describe("the scene is framed in what is free", () => {
  it("between the panels of a desktop", () => {
    const insets = insetsFrom(box(0, 56, 1600, 700), [box(16, 72, 348, 600), box(1252, 72, 1600, 300)]);
    expect(insets).toMatchObject({ left: 348, right: 348, bottom: 44 });
  });
  it("above the sheet of a phone, also when it has been pulled up", () => {
    const canvas = box(0, 56, 390, 427);
    expect(insetsFrom(canvas, [box(0, 411, 390, 1500)])).toMatchObject({ left: 0, right: 0, bottom: 16 + 44 });
    expect(insetsFrom(canvas, [box(0, 300, 390, 1400)])).toMatchObject({ bottom: 127 + 44 });
  });
  it("whole where nothing covers it", () => {
    expect(insetsFrom(box(348, 56, 1024, 448), [box(0, 56, 348, 700)])).toMatchObject({ left: 0, right: 0, bottom: 44 });
  });
});
