/** Colours of the scene, light and dark. Meaning has one colour in both: flight amber, target red, release green. */

import { Color } from "three";
import type { Theme } from "./interface";

export interface Palette {
  readonly background: Color;
  readonly floor: Color;
  readonly gridFine: Color;
  readonly gridBold: Color;
  readonly shadow: number; // darkness of the arm's shadow, 0 to 1
  readonly arm: Readonly<Record<string, Color>>; // by the names that parts use
  readonly object: Color;
  readonly launch: Color;
  readonly brake: Color;
  readonly flight: Color;
  readonly arrow: Color;
  readonly target: Color;
  readonly nearest: Color;
  readonly landing: Color;
  readonly ghostStart: Color;
  readonly ghostRelease: Color;
  readonly ghostRest: Color;
  readonly ghostPlan: Color;
  readonly keepIn: Color;
  readonly keepOut: Color;
  readonly obstacle: Color;
  readonly stale: Color;
}

const ARM = {
  shell: new Color("#dfe3e6"),
  tube: new Color("#d3d8dc"),
  metal: new Color("#9aa3ab"),
  seal: new Color("#24282d"),
  lid: new Color("#7ba3c0"),
  tool: new Color("#565e67"),
  finger: new Color("#4a525b"),
};

const MEANING = {
  object: new Color("#f08a24"),
  obstacle: new Color("#f0384a"),
};

const LIGHT: Palette = {
  ...MEANING,
  arm: ARM,
  background: new Color("#f4f6f8"),
  floor: new Color("#e9edf0"),
  gridFine: new Color("#d6dce2"),
  gridBold: new Color("#b9c3cc"),
  shadow: 0.3,
  launch: new Color("#14804a"),
  brake: new Color("#7a8794"),
  flight: new Color("#d9720b"),
  arrow: new Color("#1c2733"),
  target: new Color("#cf2a3c"),
  nearest: new Color("#0b6bcb"),
  landing: new Color("#7a3fbf"),
  ghostStart: new Color("#3b78b5"),
  ghostRelease: new Color("#14804a"),
  ghostRest: new Color("#6b7885"),
  ghostPlan: new Color("#2b6cb0"),
  keepIn: new Color("#2b6cb0"),
  keepOut: new Color("#b45309"),
  stale: new Color("#9aa5b1"),
};

const DARK: Palette = {
  ...MEANING,
  arm: ARM,
  background: new Color("#12161b"),
  floor: new Color("#1a2028"),
  gridFine: new Color("#252d37"),
  gridBold: new Color("#3a4654"),
  shadow: 0.55,
  launch: new Color("#4cc38a"),
  brake: new Color("#8492a1"),
  flight: new Color("#ffab40"),
  arrow: new Color("#f2f5f8"),
  target: new Color("#ff6b76"),
  nearest: new Color("#62aef7"),
  landing: new Color("#c39bff"),
  ghostStart: new Color("#62aef7"),
  ghostRelease: new Color("#4cc38a"),
  ghostRest: new Color("#a7b3bf"),
  ghostPlan: new Color("#62aef7"),
  keepIn: new Color("#62aef7"),
  keepOut: new Color("#f0a35a"),
  stale: new Color("#7b8794"),
};

/** Returns the palette of a theme. */
export function paletteOf(theme: Theme): Palette {
  return theme === "dark" ? DARK : LIGHT;
}
