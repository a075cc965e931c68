/** How much of the scene's edges other things cover. Pure: boxes on the screen in [px]. */

import type { Insets } from "./interface";

export interface Box {
  readonly left: number;
  readonly right: number;
  readonly top: number;
  readonly bottom: number;
}

const BAR_PX = 44; // [px] the cameras' buttons at the lower edge of what is free
const BESIDE = 0.9; // of the canvas's width: what is wider lies before it as a sheet, not beside it

/** Returns what panels cover of a canvas: at its sides, or from below where a sheet is as wide as the canvas. */
export function insetsFrom(canvas: Box, panels: readonly Box[]): Insets {
  const meets = (box: Box): boolean => box.left < canvas.right && box.right > canvas.left && box.top < canvas.bottom && box.bottom > canvas.top;
  const isSheet = (box: Box): boolean => box.right - box.left > BESIDE * (canvas.right - canvas.left);
  const met = panels.filter(meets);
  const middle = (canvas.left + canvas.right) / 2;
  const beside = met.filter((box) => !isSheet(box));
  const lefts = beside.filter((box) => (box.left + box.right) / 2 < middle).map((box) => box.right - canvas.left);
  const rights = beside.filter((box) => (box.left + box.right) / 2 >= middle).map((box) => canvas.right - box.left);
  const sheets = met.filter(isSheet).map((box) => canvas.bottom - box.top);
  return { left: Math.max(0, ...lefts), right: Math.max(0, ...rights), top: 0, bottom: Math.max(0, ...sheets) + BAR_PX };
}
