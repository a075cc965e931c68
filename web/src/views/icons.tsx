// The few drawn signs of the page.

import type { JSX } from "preact";

const PATHS = {
  play: "M5 3.5v13l11-6.5z",
  pause: "M5 3.5h3.5v13H5zM11.5 3.5H15v13h-3.5z",
  ok: "M4 10.5l4 4 8-9",
  no: "M5 5l10 10M15 5L5 15",
  wait: "M10 3a7 7 0 1 0 .01 0M10 6.5V10l2.5 1.5",
  download: "M10 3v9M6 8.5l4 4 4-4M4 16.5h12",
} as const;

export function Icon({ name }: { name: keyof typeof PATHS }): JSX.Element {
  const filled = name === "play" || name === "pause";
  return (
    <svg class={`sign ${name}`} viewBox="0 0 20 20" width="16" height="16" aria-hidden="true">
      <path
        d={PATHS[name]} fill={filled ? "currentColor" : "none"} stroke={filled ? "none" : "currentColor"} stroke-width="2"
        stroke-linecap="round" stroke-linejoin="round"
      />
    </svg>
  );
}
