// The panel of the request: form, Plan, what came back in words, and the button that moves the arm.

import type { JSX, RefObject } from "preact";
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";

import { cancelPlan, execute, plan, takeNearest } from "../state/actions";
import { openCalibration } from "../state/calibrate";
import { throwLabel } from "../state/machine";
import {
  answered, armed, cell, cellName, dryRun, faults, floorZ, isPlanning, isReal, mode, obstacle, preview, problem, progress, running, standing,
} from "../state/store";
import { against, constraintWords, figure, foundWords, plainWords, planWords, progressWords, timingWords } from "../state/words";
import { RequestFields } from "./request";

const PHONE = "(max-width: 760px)"; // as in page.css: there the scene is behind the sheet
const MOMENT_S = 0.4; // most plans are there before a line about them could be read

export function ThrowPanel(): JSX.Element {
  const planning = isPlanning.value;
  const form = useRef<HTMLFormElement>(null);
  const wrong = faults.value;
  useEffect(() => {
    if (Object.keys(wrong).length === 0) return;
    const first = form.current?.querySelector<HTMLElement>("[aria-invalid=true]");
    for (let around = first?.closest("details"); around; around = around.parentElement?.closest("details")) around.open = true;
    first?.focus();
  }, [wrong]);
  return (
    <form
      ref={form}
      class="panel request"
      aria-label="Request"
      onSubmit={(event) => {
        event.preventDefault();
        if (!planning) void plan();
      }}
    >
      <RequestFields />
      <ProblemCard />
      <PlanSummary />
      <div class="actions">
        <button type="submit" class={armed.value ? "quiet" : "primary"} disabled={cellName.value === null} aria-disabled={planning}>
          {planning ? "Plan …" : "Plan"}
        </button>
        <span class="sr-only" role="status">{planning ? "Planning" : ""}</span>
        <ThrowButton />
        <Search />
        <WhyNot />
      </div>
    </form>
  );
}

/** A search that takes longer than a moment: what it has come to, and its end. */
function Search(): JSX.Element | null {
  const told = progress.value;
  if (told === null || told.elapsed_s < MOMENT_S) return null;
  return (
    <div class="search">
      <span>{progressWords(told)}</span>
      <button type="button" class="quiet" onClick={cancelPlan}>
        Cancel
      </button>
    </div>
  );
}

/** Returns what brings an element into view whenever `news` is another. */
function useInView<T>(news: T): RefObject<HTMLDivElement | null> {
  const element = useRef<HTMLDivElement>(null);
  useEffect(() => element.current?.scrollIntoView({ block: "nearest" }), [news]);
  return element;
}

function PlanSummary(): JSX.Element | null {
  const card = useInView(answered.value);
  const dragged = preview.value;
  if (dragged) {
    return (
      <div class="summary preview">
        <strong>Preview while dragging</strong>
        <p>Ruckig alone, for a release on time; not stored. Let go for the full answer.</p>
        <p>{planWords(dragged)}</p>
      </div>
    );
  }
  const current = answered.value;
  if (current === null || problem.value !== null) return null;
  const odds = current.hit_probability;
  return (
    <div class={`summary ${standing.value}`} ref={card}>
      {standing.value === "stale" ? <strong>Planned before the last change: plan again.</strong> : null}
      <p>{planWords(current)}</p>
      <details open={!matchMedia(PHONE).matches}>
        <summary>Timing and odds</summary>
        <p class="soft">{timingWords(current)}</p>
        {odds && odds.profile === null ? (
          <p class="soft">
            How likely it hits is not known: the timing is unknown, ±20 ms.{" "}
            <button type="button" class="link" onClick={openCalibration}>
              Calibrate the cell
            </button>
          </p>
        ) : null}
        {odds && odds.profile !== null ? (
          <p class="soft">
            Hits within {figure(odds.radius_m * 1000)} mm with a probability of {figure(odds.value * 100, 2)} % (
            {figure(odds.interval.map((p) => p * 100)[0], 2)} to {figure(odds.interval.map((p) => p * 100)[1], 2)} %).
          </p>
        ) : null}
        <p class="soft">{foundWords(current)}</p>
      </details>
    </div>
  );
}

/** What stands in the way, in words, and what can be done instead. */
function ProblemCard(): JSX.Element | null {
  const refusal = problem.value;
  const card = useInView(refusal);
  if (refusal === null) return null;
  return (
    <div class="problem" role="alert" ref={card}>
      <strong>{refusal.title}</strong>
      {refusal.violations && refusal.violations.length > 0 ? (
        <ul>
          {refusal.violations.map((violation) => (
            <li key={violation.constraint}>
              <b>{constraintWords(violation.constraint)}</b>
              {violation.value !== null && violation.limit !== null
                ? `: ${against(violation.value, violation.limit, violation.unit)}`
                : ""}
              {violation.detail ? ` (${plainWords(violation.detail)})` : ""}
              <span class="soft">{violation.proven ? " – proven" : " – searched for in vain"}</span>
            </li>
          ))}
        </ul>
      ) : (
        <p>{plainWords(refusal.detail)}</p>
      )}
      {refusal.nearest ? (
        <p>
          <button type="button" class="quiet" onClick={takeNearest}>
            Take one that works
          </button>{" "}
          <span class="soft">{nearestWords(refusal.nearest)}</span>
        </p>
      ) : null}
    </div>
  );
}

interface Offer {
  readonly release?: { readonly kind: string; readonly position?: number[] | object } | null;
  readonly release_window_s?: number | null;
}

function nearestWords({ release, release_window_s: window_s }: Offer): string {
  const place = Array.isArray(release?.position) ? `(${release.position.map((x) => x.toFixed(2)).join(", ")})` : "";
  const timing = window_s ? `released up to ${figure(1000 * window_s, 2)} ms early or late` : window_s === 0 ? "without a release window" : "";
  return [place, timing, "there may be a nearer one"].filter((part) => part !== "").join(", ");
}

/** Why a plan that answers the request cannot be thrown now; null where it can, or where something runs. */
function whyNot(): string | null {
  return standing.value === "valid" && !running.value ? obstacle.value : null;
}

function WhyNot(): JSX.Element | null {
  const reason = whyNot();
  if (reason === null) return null;
  return (
    <p class="why" id="why-not" role="status">
      {reason}
    </p>
  );
}

/** Executes the plan; on a phone the sheet drops, so that the arm is seen. */
function begin(): void {
  if (matchMedia(PHONE).matches) scrollTo({ top: 0 });
  void execute(mode.value, dryRun.value);
}

/** While something runs it waits, and keeps the focus: a button that is disabled loses it. */
function ThrowButton(): JSX.Element {
  const asking = useSignal(false);
  const current = answered.value;
  const real = isReal.value;
  const act = (): void => {
    if (!armed.value) return;
    if (real && !dryRun.value) asking.value = true;
    else begin();
  };
  return (
    <>
      <button
        type="button" class={`throw ${real ? "real" : "primary"}`} disabled={!armed.value && !running.value}
        aria-disabled={!armed.value} aria-describedby={whyNot() === null ? undefined : "why-not"} onClick={act}
      >
        <Unbroken text={throwLabel(current, floorZ.value)} />
      </button>
      {asking.value && armed.value && !running.value ? (
        <AskOnceMore
          what={`${throwLabel(current, floorZ.value)}. ${current ? planWords(current) : ""}`}
          onYes={() => {
            asking.value = false;
            begin();
          }}
          onNo={() => (asking.value = false)}
        />
      ) : null}
    </>
  );
}

/** Cell and place of a throw, each on one line. */
function Unbroken({ text }: { text: string }): JSX.Element {
  const [cell, place] = text.split(" to ");
  return (
    <>
      <span class="whole">{cell}</span>
      {place === undefined ? null : <> <span class="whole">to {place}</span></>}
    </>
  );
}

/** A real arm asks once more. Escape and the first focus are on the side of not moving. */
export function AskOnceMore({ what, onYes, onNo }: { what: string; onYes: () => void; onNo: () => void }): JSX.Element {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => dialog.current?.showModal(), []);
  return (
    <dialog ref={dialog} class="ask" aria-labelledby="ask-title" onClose={onNo}>
      <h2 id="ask-title">A real arm will move</h2>
      <p>
        <b>{cellName.value}</b> {cell.value?.link_kind === "ur" ? "is not a simulation." : `says that it is a simulation, but ${cell.value?.link_host} is not on this machine.`} {what} Is everybody out of reach of the arm and of
        the flight, and the emergency stop in your hand?
      </p>
      <div class="actions">
        <button type="button" class="quiet" autofocus onClick={onNo}>
          No, keep still
        </button>
        <button type="button" class="real" onClick={onYes}>
          Yes, move the arm
        </button>
      </div>
    </dialog>
  );
}
