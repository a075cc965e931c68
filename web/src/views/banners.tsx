// What needs attention before anything else: a lost connection, a token, the last thing that did not work.

import { useSignal } from "@preact/signals";
import type { JSX } from "preact";

import { useToken } from "../state/actions";
import { access, connection, notice } from "../state/store";

export function Banners(): JSX.Element {
  return (
    <>
      {access.value === "open" ? null : <TokenCard />}
      <div class="banners">
        {connection.value === "lost" ? (
          <div class="banner bad" role="alert">
            <b>Connection to the service lost.</b> What you see is the last that it reported; trying again. Stop cannot reach the robot
            now: use the emergency stop.
          </div>
        ) : null}
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
