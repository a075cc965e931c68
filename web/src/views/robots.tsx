// Every cell in words: what its robot is, what it does, what stands in the way, and what to do about it.

import type { JSX } from "preact";

import type { CellSummary } from "../service/types";
import { acknowledge } from "../state/actions";
import { armKind, sentence } from "../state/readiness";
import { cellName, cells, cellStates, dispatch } from "../state/store";
import { cellWords } from "../state/words";

export function RobotsSection(): JSX.Element {
  const list = cells.value;
  return (
    <section class="card robots" aria-labelledby="robots-title">
      <h2 id="robots-title">Robots</h2>
      {list === null ? <p class="soft">Asking the service for its cells …</p> : null}
      {list !== null && list.length === 0 ? <p>There are no cell files. “fling up” brings its own.</p> : null}
      <ul class="cells">{list?.map((known) => <CellRow key={known.name} known={known} />)}</ul>
    </section>
  );
}

function CellRow({ known }: { known: CellSummary }): JSX.Element {
  const words = cellWords(known, cellStates.value[known.name] ?? null);
  const kind = armKind(known);
  const chosen = known.name === cellName.value;
  return (
    <li class={chosen ? "chosen" : ""}>
      <div class="who">
        <button type="button" class="link name" aria-pressed={chosen} disabled={Boolean(known.error)} onClick={() => dispatch({ type: "cell", name: known.name })}>
          {known.name}
        </button>
        <span class="soft">{known.robot?.toUpperCase() ?? ""}</span>
        {kind === "real" ? <span class="badge real">real arm</span> : null}
        {kind === "unproven" ? <span class="badge real">at {known.link_host}</span> : null}
        {kind === "simulated" && known.robot ? <span class="badge">simulated</span> : null}
        <span class={`state ${words.tone}`}>{words.headline}</span>
      </div>
      {words.reasons.map((reason) => <p class="soft" key={reason}>{sentence(reason)}</p>)}
      {words.advice ? <p class="hint">{words.advice}</p> : null}
      {words.fault && !chosen ? (
        <button type="button" class="primary small" onClick={() => void acknowledge(known.name)}>
          Acknowledge
        </button>
      ) : null}
    </li>
  );
}
