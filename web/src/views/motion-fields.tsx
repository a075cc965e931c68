// The passages of a motion: a list whose items are dragged, or moved by their buttons, each with its fields.

import type { JSX } from "preact";
import { useState } from "preact/hooks";

import { edit } from "../state/actions";
import { type Draft, ENDS } from "../state/draft";
import { FIRST_OUTPUT, moved, newPassage, type OutputDraft, OUTPUTS, type PassageDraft } from "../state/passage-draft";
import type { Kind } from "../state/state-draft";
import { openPassage } from "../state/store";
import { NumberField, SelectField, VectorField } from "./fields";
import { type StateEdit, StateFields, TargetOptions, XYZ } from "./state-fields";

const MOST = 20; // passages of a motion: the service's limit
const KINDS: readonly (readonly [Kind | "line", string])[] = [
  ["point", "point"],
  ["pose", "pose"],
  ["joint", "joints"],
  ["line", "line"],
  ["target", "throw at a target"],
];
const END_WORDS: Readonly<Record<(typeof ENDS)[number], string>> = { rest: "anywhere", home: "the cell's home", stated: "as its plan states" };

export function MotionFields({ draft }: { draft: Draft }): JSX.Element {
  const [dragged, setDragged] = useState<number | null>(null);
  const list = draft.passages;
  const put = (passages: readonly PassageDraft[]): void => edit({ passages });
  const move = (from: number, to: number): void => put(moved(list, from, to));
  return (
    <>
      <ol class="passages" aria-label="Passages">
        {list.map((passage, i) => (
          <li
            key={passage.id}
            class={dragged === i ? "dragged" : ""}
            onDragOver={(event) => {
              if (dragged === null) return;
              event.preventDefault();
              if (dragged === i) return;
              move(dragged, i);
              setDragged(i);
            }}
            onDrop={(event) => event.preventDefault()}
          >
            <div class="passage-head">
              <span class="grip" draggable title="Drag to another place" aria-hidden="true" onDragStart={() => setDragged(i)} onDragEnd={() => setDragged(null)}>
                ⠿
              </span>
              <button type="button" class="link" aria-expanded={openPassage.value === passage.id} onClick={() => (openPassage.value = openPassage.value === passage.id ? null : passage.id)}>
                {passage.name || "without a name"}
              </button>
              <span class="soft">{KINDS.find(([kind]) => kind === kindOf(passage))![1]}</span>
              <button type="button" class="chip" aria-label={`${passage.name} earlier`} disabled={i === 0} onClick={() => move(i, i - 1)}>
                ↑
              </button>
              <button type="button" class="chip" aria-label={`${passage.name} later`} disabled={i === list.length - 1} onClick={() => move(i, i + 1)}>
                ↓
              </button>
              <button type="button" class="chip" aria-label={`Remove ${passage.name}`} disabled={list.length === 1} onClick={() => put(list.filter((_, k) => k !== i))}>
                ×
              </button>
            </div>
            {openPassage.value === passage.id ? <PassageFields passage={passage} path={`passages[${i}]`} change={(fields, request) => edit({ ...request, passages: list.map((each, k) => (k === i ? { ...each, ...fields } : each)) })} /> : null}
          </li>
        ))}
      </ol>
      <button
        type="button" class="chip" disabled={list.length >= MOST}
        onClick={() => {
          const added = newPassage(list);
          put([...list, added]);
          openPassage.value = added.id;
        }}
      >
        Add a passage
      </button>
      <SelectField label="Comes to rest" options={ENDS.filter((end) => end !== "stated" || draft.statedEnd).map((end) => [end, END_WORDS[end]] as const)} value={draft.end} onChoose={(end) => edit({ end })} />
    </>
  );
}

const kindOf = (passage: PassageDraft): Kind | "line" => (passage.isLine ? "line" : passage.state.kind);

interface PassageProps {
  readonly passage: PassageDraft;
  readonly path: string;
  readonly change: (fields: Partial<PassageDraft>, request?: Partial<Draft>) => void;
}

function PassageFields({ passage, path, change }: PassageProps): JSX.Element {
  const { state, isLine } = passage;
  const editState = ({ frame, ...fields }: StateEdit): void => change({ state: { ...state, ...fields } }, frame && { frame });
  const throws = !isLine && state.kind === "target";
  const choose = (kind: Kind | "line"): void =>
    change(kind === "line" ? { isLine: true } : { isLine: false, state: { ...state, kind }, releases: kind === "target" || passage.releases });
  return (
    <div class="passage-fields">
      <div class="numbers of-2">
        <label class="field">
          <span>Name</span>
          <input type="text" aria-label="Name" autocomplete="off" value={passage.name} onInput={(event) => change({ name: event.currentTarget.value })} />
        </label>
        <SelectField label="Passes" options={KINDS} value={kindOf(passage)} onChoose={choose} />
      </div>
      {isLine ? <LineFields passage={passage} path={path} change={change} /> : <StateFields draft={state} path={`${path}.state`} edit={editState} />}
      {throws ? <TargetOptions draft={state} path={`${path}.state`} edit={editState} /> : null}
      {isLine || throws ? null : (
        <label class="check">
          <input type="checkbox" checked={passage.releases} onChange={(event) => change({ releases: event.currentTarget.checked })} />
          <span>Lets the object go</span>
        </label>
      )}
      <div class="numbers of-2">
        <NumberField label="At" unit="s" path={`${path}.at_s`} placeholder="soonest" value={passage.at} onInput={(at) => change({ at })} />
        <NumberField label="Not before" unit="s" path={`${path}.not_before_s`} placeholder="free" value={passage.notBefore} onInput={(notBefore) => change({ notBefore })} />
      </div>
      <OutputFields passage={passage} path={path} change={change} />
    </div>
  );
}

function LineFields({ passage, path, change }: PassageProps): JSX.Element {
  const { line } = passage;
  const edit = (fields: Partial<PassageDraft["line"]>): void => change({ line: { ...line, ...fields } });
  return (
    <>
      <VectorField legend="From" unit="m" path={`${path}.line.from.position`} names={XYZ} values={line.from} onInput={(from) => edit({ from })} />
      <VectorField legend="Turned by" unit="rad" path={`${path}.line.from.rotation_vector`} names={XYZ} values={line.fromRotation} onInput={(fromRotation) => edit({ fromRotation })} />
      <VectorField legend="To" unit="m" path={`${path}.line.to.position`} names={XYZ} values={line.to} onInput={(to) => edit({ to })} />
      <VectorField legend="There by" unit="rad" path={`${path}.line.to.rotation_vector`} names={XYZ} values={line.toRotation} onInput={(toRotation) => edit({ toRotation })} />
      <NumberField label="Tool speed" unit="m/s" path={`${path}.line.speed_m_s`} value={line.speed} onInput={(speed) => edit({ speed })} />
    </>
  );
}

function OutputFields({ passage, path, change }: PassageProps): JSX.Element {
  const { outputs, isLine } = passage;
  const put = (i: number, fields: Partial<OutputDraft>): void => change({ outputs: outputs.map((each, k) => (k === i ? { ...each, ...fields } : each)) });
  return (
    <>
      {outputs.map((output, i) => (
        <fieldset class="vector" key={i}>
          <legend>
            Output {i + 1}
            <button type="button" class="link" onClick={() => change({ outputs: outputs.filter((_, k) => k !== i) })}>
              remove
            </button>
          </legend>
          <div class="numbers of-2">
            <SelectField label="Bank" options={OUTPUTS.map((kind) => [kind, kind.replaceAll("_", " ")] as const)} value={output.output} onChoose={(kind) => put(i, { output: kind })} />
            <NumberField label="Number" path={`${path}.outputs[${i}].index`} value={output.index} onInput={(index) => put(i, { index })} />
            <SelectField label="Switches" options={[["on", "on"], ["off", "off"]]} value={output.level ? "on" : "off"} onChoose={(level) => put(i, { level: level === "on" })} />
            <NumberField label="After" unit="s" path={`${path}.outputs[${i}].offset_s`} placeholder="0" value={output.offset} onInput={(offset) => put(i, { offset })} />
            {isLine ? <NumberField label="Along the line" unit="m" path={`${path}.outputs[${i}].offset_m`} placeholder="0" value={output.place} onInput={(place) => put(i, { place })} /> : null}
          </div>
        </fieldset>
      ))}
      <button type="button" class="link" onClick={() => change({ outputs: [...outputs, FIRST_OUTPUT] })}>
        Add an output
      </button>
    </>
  );
}
