// Starts the page.

import { effect } from "@preact/signals";
import { render } from "preact";

import { App } from "./app";
import { keepFocus } from "./focus";
import { stop } from "./state/actions";
import { followCalibration } from "./state/calibrate";
import { follow } from "./state/follow";
import { listenForPlayback } from "./state/playback";
import { dark, endTime, isReal, playing, running, state, time } from "./state/store";
import "./style/page.css";

/** Moves the cursor while it plays. */
function play(): void {
  let last: number | null = null;
  const step = (now: number): void => {
    if (playing.value === 0) {
      last = null;
      return;
    }
    const passed = last === null ? 0 : (now - last) / 1000;
    last = now;
    time.value = Math.min(endTime.value, time.value + passed * playing.value);
    if (time.value >= endTime.value) playing.value = 0;
    requestAnimationFrame(step);
  };
  effect(() => {
    if (playing.value !== 0 && last === null) requestAnimationFrame(step);
  });
}

/** Escape stops whatever runs on the cell, also what the page has not seen yet; dialogs and fields have it besides. */
function listenForStop(): void {
  addEventListener(
    "keydown",
    (event) => {
      if (event.key !== "Escape") return;
      if (running.value) event.preventDefault();
      void stop(!running.value);
    },
    { capture: true },
  );
}

function followTheme(): void {
  const query = matchMedia("(prefers-color-scheme: dark)");
  dark.value = query.matches;
  query.addEventListener("change", () => (dark.value = query.matches));
}

const root = document.getElementById("app");
if (root) {
  followTheme();
  listenForStop();
  listenForPlayback();
  keepFocus(root);
  play();
  effect(() => {
    document.documentElement.classList.toggle("real-arm", isReal.value);
  });
  effect(() => {
    document.title = running.value ? `Throwing on ${state.value.cell} – Fling` : "Fling";
  });
  render(<App />, root);
  follow();
  followCalibration();
}
