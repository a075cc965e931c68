// The cursor's time: it plays, and the keyboard moves it by ticks. As players of recordings do, space plays and arrows step.

import { endTime, playing, running, shown, time } from "./store";

const MANY = 10; // [ticks] that an arrow goes with Shift
const AT_END_S = 1e-6; // [s] of rounding
const TEXT = "input, select, textarea, dialog *, [tabindex]:not(canvas)"; // what has arrows of its own
const PRESSED = "button, summary, a"; // and what space presses

/** Plays at a pace, or stands still where it plays so already; from the start once it is over. */
export function play(pace: number): void {
  if (playing.value === 0 && time.value >= endTime.value - AT_END_S) time.value = 0;
  playing.value = playing.value === pace ? 0 : pace;
}

/** One tick of the plan that is shown [s]. */
export function tick(): number {
  return 1 / (shown.value?.sample_rate_hz ?? 500);
}

/** Moves the cursor by ticks, from a whole one to a whole one. */
function step(count: number): void {
  playing.value = 0;
  time.value = Math.min(endTime.value, Math.max(0, (Math.round(time.value / tick()) + count) * tick()));
}

export function listenForPlayback(): void {
  addEventListener("keydown", (event) => {
    const control = event.target instanceof Element ? event.target : document.body;
    if (endTime.value === 0 || running.value || event.ctrlKey || event.altKey || event.metaKey || control.matches(TEXT)) return;
    const count = event.shiftKey ? MANY : 1;
    if (event.key === " " && !control.matches(PRESSED)) play(1);
    else if (event.key === "ArrowLeft") step(-count);
    else if (event.key === "ArrowRight") step(count);
    else return;
    event.preventDefault();
  });
}
