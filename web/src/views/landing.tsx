// Where the object of an execution landed: what was reported, and the form that reports more of it.

import { useSignal } from "@preact/signals";
import type { JSX } from "preact";

import type { LandingAnswer, LandingRequest, Plan } from "../service/types";
import { reportLanding, settleDoubt, withdrawLanding } from "../state/actions";
import { placeReport, RESULTS, resultReport, targetRadius } from "../state/landing-report";
import { aimOf, placeWords } from "../state/machine";
import { doubt, floorZ, landings, landingStd, notice, picking } from "../state/store";
import { landingWords, length } from "../state/words";
import { NumberField, VectorField } from "./fields";

export function LandingReports({ id, plan, open = false }: { id: string; plan: Plan | null; open?: boolean }): JSX.Element {
  const known = landings.value[id] ?? [];
  return (
    <div class="landing">
      {known.length > 0 ? (
        <ul aria-label="Reports of the landing">{known.map((landing) => <Report key={landing.id} landing={landing} />)}</ul>
      ) : null}
      {doubt.value?.id === id ? <Doubted distance_m={doubt.value.distance_m} plan={plan} /> : null}
      <details class="options" open={open}>
        <summary>Report the landing</summary>
        <PlaceForm id={id} plan={plan} />
        <ResultForm id={id} plan={plan} />
      </details>
    </div>
  );
}

function Report({ landing }: { landing: LandingAnswer }): JSX.Element {
  const isGone = landing.withdrawn_at !== null && landing.withdrawn_at !== undefined;
  return (
    <li class={isGone ? "withdrawn" : ""}>
      {isGone ? <s>{reportWords(landing)}</s> : reportWords(landing)}
      {isGone ? " – withdrawn" : null}
      {isGone || landing.source === "sim-camera" ? null : (
        <button type="button" class="link" onClick={() => void withdrawLanding(landing.execution_id, landing.id)}>
          Withdraw
        </button>
      )}
    </li>
  );
}

/** A place that is likely a slip: of the hand, of the unit, or of the throw. */
function Doubted({ distance_m, plan }: { distance_m: number; plan: Plan | null }): JSX.Element {
  const planned = plan?.flight?.landing_point;
  return (
    <div class="problem" role="alertdialog" aria-label="Is this meant?">
      <p>
        This is {length(distance_m)} from where this throw was to land{planned ? `, ${placeWords(planned, floorZ.value)}` : ""}. Report it all the same?
      </p>
      <div class="actions">
        <button type="button" class="quiet small" onClick={() => void settleDoubt(false)}>
          No
        </button>
        <button type="button" class="quiet small" onClick={() => void settleDoubt(true)}>
          Report it
        </button>
      </div>
    </div>
  );
}

function reportWords(landing: LandingAnswer): string {
  const words = landingWords(landing);
  return `${words[0]?.toUpperCase()}${words.slice(1)} (${landing.source})`;
}

/** Sends a report, or says which text in it is no number. */
function send(id: string, made: () => LandingRequest): void {
  try {
    void reportLanding(id, made());
  } catch (error) {
    notice.value = { kind: "bad", text: `In the report, ${(error as Error).message}.` };
  }
}

/** A place, pointed at or measured. */
function PlaceForm({ id, plan }: { id: string; plan: Plan | null }): JSX.Element {
  const typed = useSignal<readonly string[] | null>(null);
  const place = typed.value ?? ["", "", String((plan && aimOf(plan)?.[2]) ?? 0)];
  const points = picking.value === id;
  const toggle = (): void => {
    picking.value = points ? null : id;
    if (!points) window.scrollTo({ top: 0 }); // to the scene, which panels may cover
  };
  return (
    <>
      <div class="pointing">
        <NumberField label="Uncertainty" unit="m" value={landingStd.value} onInput={(value) => (landingStd.value = value)} />
        <button type="button" class="quiet small" aria-pressed={points} onClick={toggle}>
          {points ? "Click where it landed …" : "Point at the floor"}
        </button>
      </div>
      <VectorField legend="Landing" unit="m" names={["x", "y", "z"]} values={place} onInput={(values) => (typed.value = values)} />
      <button type="button" class="quiet small" onClick={() => send(id, () => placeReport(place, landingStd.value))}>
        Report this place
      </button>
    </>
  );
}

/** Whether the target was hit; nothing for a throw at no target. */
function ResultForm({ id, plan }: { id: string; plan: Plan | null }): JSX.Element | null {
  const typed = useSignal<string | null>(null);
  const own = targetRadius(plan);
  if (own === null) return null;
  const radius = typed.value ?? own;
  return (
    <fieldset class="result">
      <legend>Or only whether it hit the target</legend>
      <NumberField label="Target’s radius" unit="m" value={radius} onInput={(value) => (typed.value = value)} />
      <div class="actions">
        {RESULTS.map(([result, text]) => (
          <button key={result} type="button" class="quiet small" onClick={() => send(id, () => resultReport(result, radius))}>
            {text}
          </button>
        ))}
      </div>
    </fieldset>
  );
}
