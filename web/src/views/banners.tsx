// What needs attention before anything else: a lost connection, a token, the last thing that did not work.

import { useSignal } from "@preact/signals";
import type { JSX } from "preact";

import { acknowledge, useToken } from "../state/actions";
import { sentence } from "../state/readiness";
import { access, cell, cellState, connection, notice } from "../state/store";
import { cellWords } from "../state/words";

export function Banners(): JSX.Element {
  return (
    <>
      <div class="banners">
        {access.value === "open" ? null : <TokenCard />}
        {connection.value === "lost" ? (
          <div class="banner bad" role="alert">
            <b>Connection to the service lost.</b> What you see is the last that it reported; trying again. Stop cannot reach the robot
            now: use the emergency stop.
          </div>
        ) : null}
        <FaultBanner />
        {notice.value ? (
          <div class={`banner ${notice.value.kind}`} role={notice.value.kind === "bad" ? "alert" : "status"}>
            <span>{notice.value.text}</span>
            <button type="button" class="link" aria-label="Dismiss" onClick={() => (notice.value = null)}>
              ✕
            </button>
          </div>
        ) : null}
      </div>
    </>
  );
}

/** The latched fault of the chosen cell, with the button that it asks for. */
function FaultBanner(): JSX.Element | null {
  const chosen = cell.value;
  const live = cellState.value;
  if (chosen === null || !live?.fault) return null;
  const words = cellWords(chosen, live);
  const silent = live.executor?.alive !== true;
  return (
    <div class="banner bad fault" role="alert">
      <span>
        <b>{words.headline}.</b> {words.reasons.map((reason) => `${sentence(reason)} `)}
        {words.advice}
      </span>
      <button type="button" class="primary small" disabled={silent} onClick={() => void acknowledge(chosen.name)}>
        Acknowledge
      </button>
    </div>
  );
}

function TokenCard(): JSX.Element {
  const value = useSignal("");
  return (
    <form
      class="banner token"
      aria-label="Token"
      onSubmit={(event) => {
        event.preventDefault();
        void useToken(value.value.trim());
      }}
    >
      <p>
        <b>{access.value === "token-refused" ? "This token is not known to the service." : "This service asks for a token."}</b> Whoever
        runs it makes one with <code>fling token create</code>. It is kept for this tab only.
      </p>
      <div class="actions">
        <label class="field">
          <span>Token</span>
          <input type="password" autocomplete="off" value={value.value} onInput={(event) => (value.value = event.currentTarget.value)} />
        </label>
        <button type="submit" class="primary">
          Use it
        </button>
      </div>
    </form>
  );
}
