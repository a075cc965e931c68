// The passages of a motion as the form holds them, and their translation to the service's request and back.

import type { PassageRequest, PlanRequest } from "../service/types";
import { defined, numberOf, numbersOf, optional, texts, textOf } from "./numbers";
import { FIRST_STATE_DRAFT, type Release, releaseOf, type StateDraft, stateOf } from "./state-draft";

export const OUTPUTS = ["standard_digital", "configurable_digital", "tool_digital"] as const;
export type OutputKind = (typeof OUTPUTS)[number];

/** An output that switches about a passage. */
export interface OutputDraft {
  readonly output: OutputKind;
  readonly index: string;
  readonly level: boolean;
  readonly offset: string; // [s]; empty: at the passage
  readonly place: string; // on a line, from its start [m]; empty: its start
}

/** A line from a pose to another; orientations are rotation vectors. */
interface LineDraft {
  readonly from: readonly string[]; // (3) [m]
  readonly fromRotation: readonly string[]; // (3) [rad]
  readonly to: readonly string[];
  readonly toRotation: readonly string[];
  readonly speed: string; // [m/s]
}

/** A state or a line to pass. */
export interface PassageDraft {
  readonly id: number; // tells passages apart while they are moved
  readonly name: string;
  readonly isLine: boolean;
  readonly state: StateDraft;
  readonly line: LineDraft;
  readonly releases: boolean;
  readonly gripper: string; // that lets go there; empty: the cell's own
  readonly outputs: readonly OutputDraft[];
  readonly at: string; // [s] from the motion's start; empty: as soon as possible
  readonly notBefore: string; // [s]
}

const DOWN = ["3.14159", "0", "0"] as const; // [rad] the tool points to the floor
const FIRST_LINE: LineDraft = { from: ["0.45", "-0.2", "0.35"], fromRotation: DOWN, to: ["0.45", "0.2", "0.35"], toRotation: DOWN, speed: "0.4" };
export const FIRST_OUTPUT: OutputDraft = { output: "standard_digital", index: "1", level: true, offset: "", place: "" };

/** Returns a new passage, a point, with a name of its own. */
export function newPassage(others: readonly PassageDraft[]): PassageDraft {
  const names = others.map(({ name }) => name);
  let number = others.length + 1;
  while (names.includes(`passage ${number}`)) number += 1;
  const id = 1 + Math.max(0, ...others.map((other) => other.id));
  return {
    id, name: `passage ${number}`, isLine: false, state: { ...FIRST_STATE_DRAFT, kind: "point" }, line: FIRST_LINE, releases: false, gripper: "", outputs: [], at: "", notBefore: "",
  };
}

/** Returns the list with one passage at another place. */
export function moved<T>(list: readonly T[], from: number, to: number): T[] {
  const rest = list.filter((_, i) => i !== from);
  return [...rest.slice(0, to), list[from]!, ...rest.slice(to)];
}

/** Returns a passage as requests state it. Throws InvalidDraft for text that is no number. */
export function passageOf(draft: PassageDraft, path: string, now_s: number | null): PassageRequest {
  const stated = draft.isLine ? { line: lineOf(draft.line, `${path}.line`) } : { state: releaseOf(draft.state, `${path}.state`, now_s) };
  return defined({
    name: draft.name,
    ...stated,
    releases: draft.releases && !draft.isLine ? draft.gripper || (true as const) : undefined,
    at_s: optional(draft.at, "time", `${path}.at_s`),
    not_before_s: optional(draft.notBefore, "earliest time", `${path}.not_before_s`),
    outputs: draft.outputs.length > 0 ? draft.outputs.map((output, i) => outputOf(output, draft.isLine, `${path}.outputs[${i}]`)) : undefined,
  }) as PassageRequest;
}

function lineOf(line: LineDraft, path: string): NonNullable<PassageRequest["line"]> {
  const end = (name: "from" | "to", rotation: readonly string[]) => ({
    position: numbersOf(line[name], `line ${name}`, `${path}.${name}.position`),
    rotation_vector: numbersOf(rotation, `rotation ${name}`, `${path}.${name}.rotation_vector`),
  });
  return { from: end("from", line.fromRotation), to: end("to", line.toRotation), speed_m_s: numberOf(line.speed, "speed", `${path}.speed_m_s`) };
}

function outputOf(draft: OutputDraft, onLine: boolean, path: string): NonNullable<PassageRequest["outputs"]>[number] {
  return defined({
    output: draft.output,
    index: numberOf(draft.index, "output", `${path}.index`),
    level: draft.level,
    offset_s: optional(draft.offset, "offset", `${path}.offset_s`),
    offset_m: onLine ? optional(draft.place, "place", `${path}.offset_m`) : undefined,
  }) as NonNullable<PassageRequest["outputs"]>[number];
}

/** Returns the form of passages; what it has no field for is left out. */
export function passagesOf(asked: NonNullable<PlanRequest["passages"]>): PassageDraft[] {
  return asked.map((passage, i) => ({
    ...newPassage([]),
    id: i + 1,
    name: passage.name,
    isLine: Boolean(passage.line),
    ...(passage.state ? { state: stateOf(passage.state as Release) } : {}),
    ...(passage.line ? { line: lineTexts(passage.line) } : {}),
    releases: Boolean(passage.releases),
    gripper: typeof passage.releases === "string" ? passage.releases : "",
    outputs: (passage.outputs ?? []).map((each) => ({
      output: each.output as OutputKind, index: String(each.index), level: each.level, offset: each.offset_s ? String(each.offset_s) : "", place: textOf(each.offset_m),
    })),
    at: textOf(passage.at_s),
    notBefore: textOf(passage.not_before_s),
  }));
}

function lineTexts(line: NonNullable<PassageRequest["line"]>): LineDraft {
  const rotation = (end: { rotation_vector?: number[] | null }): readonly string[] => (end.rotation_vector ? texts(end.rotation_vector) : ["", "", ""]);
  return {
    from: texts(line.from.position), fromRotation: rotation(line.from), to: texts(line.to.position), toRotation: rotation(line.to), speed: String(line.speed_m_s),
  };
}
