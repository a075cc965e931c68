/** The scene's colours as three.js takes them. */

import { Color } from "three";
import { COLOURS, type Tone } from "./colours";
import type { Theme } from "./interface";

export type Palette = Readonly<Record<Tone, Color>> & {
  readonly shadow: number; // darkness of the arm's shadow, 0 to 1
  readonly arm: Readonly<Record<string, Color>>; // by the names that parts use
};

const ARM = {
  shell: new Color("#dfe3e6"),
  tube: new Color("#d3d8dc"),
  metal: new Color("#9aa3ab"),
  seal: new Color("#24282d"),
  lid: new Color("#7ba3c0"),
  tool: new Color("#565e67"),
  finger: new Color("#4a525b"),
};
const SHADOWS: Readonly<Record<Theme, number>> = { light: 0.3, dark: 0.55 };

/** Returns the palette of a theme. */
export function paletteOf(theme: Theme): Palette {
  const colours = Object.entries(COLOURS[theme]).map(([tone, hex]) => [tone, new Color(hex)]);
  return { ...(Object.fromEntries(colours) as Record<Tone, Color>), shadow: SHADOWS[theme], arm: ARM };
}
