/** Colours of the scene, light and dark. Meaning has one colour in both: flight amber, target red, release green. */

import type { Theme } from "./interface";

const MEANING = {
  object: "#f08a24",
  obstacle: "#f0384a",
};

export const COLOURS = {
  light: {
    ...MEANING,
    background: "#f4f6f8",
    floor: "#e9edf0",
    gridFine: "#d6dce2",
    gridBold: "#b9c3cc",
    launch: "#14804a",
    brake: "#7a8794",
    flight: "#d9720b",
    arrow: "#1c2733",
    target: "#cf2a3c",
    nearest: "#0b6bcb",
    landing: "#7a3fbf",
    ghostStart: "#3b78b5",
    ghostRelease: "#14804a",
    ghostRest: "#6b7885",
    ghostPlan: "#2b6cb0",
    keepIn: "#2b6cb0",
    keepOut: "#b45309",
    stale: "#9aa5b1",
  },
  dark: {
    ...MEANING,
    background: "#12161b",
    floor: "#1a2028",
    gridFine: "#252d37",
    gridBold: "#3a4654",
    launch: "#4cc38a",
    brake: "#8492a1",
    flight: "#ffab40",
    arrow: "#f2f5f8",
    target: "#ff6b76",
    nearest: "#62aef7",
    landing: "#c39bff",
    ghostStart: "#62aef7",
    ghostRelease: "#4cc38a",
    ghostRest: "#a7b3bf",
    ghostPlan: "#62aef7",
    keepIn: "#62aef7",
    keepOut: "#f0a35a",
    stale: "#7b8794",
  },
} as const satisfies Record<Theme, Record<string, string>>;

/** What has a colour. */
export type Tone = keyof (typeof COLOURS)["light"];
