// The top of the page: which cell, how it is, and Stop, which is always there.

import type { JSX } from "preact";

import type { CellSummary } from "../service/types";
import { stop } from "../state/actions";
import { cell, cellName, cells, cellStates, connection, dispatch, isReal, running } from "../state/store";
import { armKind } from "../state/readiness";
import { cellWords } from "../state/words";

export function Header(): JSX.Element {
  const list = cells.value ?? [];
  const chosen = cell.value;
  const words = chosen ? cellWords(chosen, cellStates.value[chosen.name] ?? null) : null;
  const lost = connection.value === "lost";
  return (
    <header class={`top ${isReal.value ? "real" : ""}`}>
      <h1>Fling</h1>
      <div class="cell-choice">
        <select aria-label="Cell" value={cellName.value ?? ""} onChange={(event) => dispatch({ type: "cell", name: event.currentTarget.value })}>
          {list.length === 0 ? <option value="">{cells.value === null ? "–" : "no cell"}</option> : null}
          {list.map((known) => (
            <option key={known.name} value={known.name} disabled={Boolean(known.error)}>
              {known.name}
              {known.error ? " (refused)" : KIND_WORDS[armKind(known)]}
            </option>
          ))}
        </select>
      </div>
      {chosen ? <KindBadge chosen={chosen} /> : null}
      {words ? <span class={`state ${lost ? "idle" : words.tone}`} role="status">{lost ? "Not known" : words.headline}</span> : null}
      {cells.value === null && !lost ? <span class="state idle" role="status">Connecting …</span> : null}
      <nav aria-label="Documentation">
        <a href="/docs">API</a>
        <a href="/problems">Errors</a>
      </nav>
      <StopButton />
    </header>
  );
}

const KIND_WORDS = { real: " (real arm)", simulated: "", unproven: " (not on this machine)" } as const;

function KindBadge({ chosen }: { chosen: CellSummary }): JSX.Element {
  const kind = armKind(chosen);
  if (kind === "real") return <span class="badge real">Real arm</span>;
  if (kind === "unproven") return <span class="badge real">At {chosen.link_host}</span>;
  return <span class="badge">Simulated</span>;
}

function StopButton(): JSX.Element {
  return (
    <div class={`stop-place ${running.value ? "running" : ""}`}>
      <button type="button" class="stop" aria-label="Stop" aria-keyshortcuts="Escape" aria-describedby="stop-note" onClick={() => void stop()}>
        Stop <kbd aria-hidden="true">Esc</kbd>
      </button>
      <span id="stop-note" class="stop-note">
        Not a safety function: use the emergency stop.
      </span>
    </div>
  );
}
