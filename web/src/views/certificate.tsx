// The certificate as margin bars: how much of each limit is left. A click goes to the instant in scene and curves.

import type { JSX } from "preact";

import { bindingCheck, FORMAL, relationOf, relativeMargin, unitText } from "../curves/quantities";
import type { Check } from "../service/types";
import { answered, playing, shown, standing, time } from "../state/store";
import { constraintWords, figure, plainWords } from "../state/words";

export function CertificateSection(): JSX.Element {
  const plan = shown.value;
  const stale = standing.value === "stale" && plan === answered.value;
  return (
    <section class={`card certificate ${stale ? "stale" : ""}`} aria-labelledby="certificate-title">
      <h2 id="certificate-title">Certificate</h2>
      {plan === null ? (
        <p class="soft">Every plan is checked again, without knowing how it was found. Its margins appear here.</p>
      ) : (
        <Bars checks={plan.certificate.checks} missing={plan.certificate.not_checked} />
      )}
    </section>
  );
}

function Bars({ checks, missing }: { checks: readonly Check[]; missing: readonly string[] }): JSX.Element {
  const binding = bindingCheck(checks);
  const sorted = [...checks].sort((a, b) => (relativeMargin(a) ?? 1) - (relativeMargin(b) ?? 1));
  const failed = checks.filter((check) => !check.ok).length;
  const hard = sorted.filter((check) => !check.ok || (!FORMAL.has(check.name) && (relativeMargin(check) ?? 1) < 1));
  const easy = sorted.filter((check) => !hard.includes(check));
  return (
    <>
      <p class={failed ? "bad" : "soft"}>
        {failed
          ? `${failed} of ${checks.length} checks fail.`
          : `All ${checks.length} checks hold, between samples too.${binding ? ` ${constraintWords(binding.name)} is the limit that binds.` : ""}`}
      </p>
      <ul class="bars">{hard.map((check) => <Bar key={check.name} check={check} binding={check === binding} />)}</ul>
      {easy.length > 0 ? <p class="hint">Hold by far: {easy.map((check) => constraintWords(check.name).toLowerCase()).join(", ")}.</p> : null}
      {missing.length > 0 ? (
        <details class="options">
          <summary>Not checked ({missing.length})</summary>
          <p class="hint">{missing.map((name) => plainWords(name)).join("; ")}</p>
        </details>
      ) : null}
    </>
  );
}

function Bar({ check, binding }: { check: Check; binding: boolean }): JSX.Element {
  const margin = relativeMargin(check) ?? 0;
  const go = (): void => {
    playing.value = 0;
    if (check.at_s !== null) time.value = check.at_s;
  };
  const unit = ["", "1", "-"].includes(check.unit) ? "" : ` ${unitText(check.unit)}`;
  return (
    <li>
      <button type="button" class={`bar-row ${binding ? "binding" : ""} ${check.ok ? "" : "failed"}`} disabled={check.at_s === null} onClick={go}>
        <span class="name">{constraintWords(check.name)}</span>
        <span class="numbers-text">
          {figure(check.value)} {relationOf(check)} {figure(check.limit)}
          {unit}
        </span>
        <svg class="meter" viewBox="0 0 100 4" preserveAspectRatio="none" aria-hidden="true">
          <rect class="all" width="100" height="4" />
          <rect class="left" width={Math.max(1, 100 * (1 - margin))} height="4" />
        </svg>
        <span class="sr-only">{check.ok ? `holds, ${figure(margin * 100, 2)} % of the limit left` : "violated"}</span>
      </button>
    </li>
  );
}
