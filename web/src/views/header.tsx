// The top of the page: which cell, how it is, and Stop, which is always there.

import type { JSX } from "preact";

import { stop } from "../state/actions";
import { cell, cellName, cells, cellStates, connection, dispatch, isReal, running } from "../state/store";
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
              {known.error ? " (refused)" : known.link_kind === "ur" ? " (real arm)" : ""}
            </option>
          ))}
        </select>
      </div>
      {isReal.value ? <span class="badge real">Real arm</span> : chosen ? <span class="badge">Simulated</span> : null}
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
