// What the colours of the scene mean.

import type { JSX } from "preact";

import { COLOURS, type Tone } from "../scene/colours";
import { answered, dark, preview, problem, running, shown, standing } from "../state/store";

/** Returns what is in the picture now, with its colour. */
function entries(): (readonly [Tone, string])[] {
  const plan = shown.value;
  const nearest: (readonly [Tone, string])[] = problem.value?.nearest ? [["nearest", "one that works"]] : [];
  if (plan === null || (plan === answered.value && standing.value === "stale")) return nearest;
  const postures: (readonly [Tone, string])[] = [["ghostStart", "start"], ["ghostRelease", "release"], ["ghostRest", "at rest"]];
  const ghosts: (readonly [Tone, string])[] = running.value ? [["ghostPlan", "plan"]] : preview.value ? [] : postures;
  const flies = plan.flight !== null && plan.flight !== undefined;
  const window = plan.flight?.window.length ? "flight, early and late" : "flight";
  return [...ghosts, ...(flies ? [["flight", plan.landing_ellipse ? `${window}, 95 % of landings` : window] as const] : []), ...nearest];
}

export function SceneKey(): JSX.Element | null {
  const colours = COLOURS[dark.value ? "dark" : "light"];
  const list = entries();
  if (list.length === 0) return null;
  return (
    <ul class="scene-key" aria-label="Key of the scene">
      {list.map(([tone, text]) => (
        <li key={text}>
          <i aria-hidden="true" style={{ background: colours[tone] }} />
          {text}
        </li>
      ))}
    </ul>
  );
}
