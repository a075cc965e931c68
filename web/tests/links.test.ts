// Addresses, what a request is in the form, and recordings that are compared.

import { describe, expect, it } from "vitest";

import type { PlanRequest } from "../src/service/types";
import { draftOf, FIRST_DRAFT, requestOf, withNearest } from "../src/state/draft";
import { FIRST_OUTPUT, moved, newPassage } from "../src/state/passage-draft";
import { FIRST_STATE_DRAFT } from "../src/state/state-draft";
import { hashOf, isSameRequest, linkOf } from "../src/state/links";
import { change, FIRST_STATE, isArmed, planStanding } from "../src/state/machine";
import { deviationOf, together } from "../src/state/recordings";

const ID = "01a223db-0c93-76b1-a087-6c59371afaf9";

describe("an address", () => {
  it("names a plan or an execution, and nothing else", () => {
    expect(linkOf(hashOf({ kind: "plan", id: ID }))).toEqual({ kind: "plan", id: ID });
    expect(linkOf(`#/execution/${ID}`)).toEqual({ kind: "execution", id: ID });
    for (const other of ["", "#/", "#/plan/", `#/cells/${ID}`, "#/plan/../../x"]) expect(linkOf(other)).toBeNull();
  });
});

describe("a request", () => {
  const drafts = [
    FIRST_DRAFT,
    { ...FIRST_DRAFT, target: ["1.1", "-0.4", "0.2"], bin: true, window: "0.005", hitProbability: "0.9", maxSpeed: "3" },
    { ...FIRST_DRAFT, bin: true, moves: true, targetVelocity: ["0.1", "-0.2"], observedAt: "100.25", startsAfter: "3.7" },
    {
      ...FIRST_DRAFT, isMotion: true, end: "home" as const,
      passages: [
        { ...newPassage([]), name: "bead", isLine: true, outputs: [{ ...FIRST_OUTPUT, place: "0.1", offset: "-0.004" }, { ...FIRST_OUTPUT, level: false, place: "0.3" }] },
        { ...newPassage([]), id: 2, name: "throw", releases: true, notBefore: "1.5", state: { ...FIRST_STATE_DRAFT, moves: true, observedAt: "7" } },
      ],
    },
    { ...FIRST_DRAFT, kind: "point" as const, velocityLimit: "2.5", jerkLimit: "1 2 3 4 5 6", frame: "base" as const },
    { ...FIRST_DRAFT, kind: "pose" as const, orientation: "quaternion" as const, start: "current" as const },
    { ...FIRST_DRAFT, kind: "joint" as const, start: "positions" as const, backend: "ruckig" as const, timeLimit: "3" },
  ];
  it("is the same in the form and back", () => {
    for (const draft of drafts) {
      const asked = requestOf(draft, "c");
      expect(isSameRequest(requestOf(draftOf(asked), "c"), asked)).toBe(true);
    }
  });
  it("is another one with another number", () => {
    const asked = requestOf(FIRST_DRAFT, "c");
    expect(isSameRequest(requestOf({ ...FIRST_DRAFT, target: ["1.2", "0.3", "0.01"] }, "c"), asked)).toBe(false);
  });
  it("that the form has no field for is not what the form asks for", () => {
    const asked = { ...requestOf(FIRST_DRAFT, "c"), passages: [{ name: "camera" }] } as unknown as PlanRequest;
    expect(isSameRequest(requestOf(draftOf(asked), "c"), asked)).toBe(false);
  });
});

describe("the passages of a motion", () => {
  it("are moved within their list", () => {
    expect(moved(["a", "b", "c"], 0, 2)).toEqual(["b", "c", "a"]);
    expect(moved(["a", "b", "c"], 2, 0)).toEqual(["c", "a", "b"]);
    expect(moved(["a", "b", "c"], 1, 1)).toEqual(["a", "b", "c"]);
  });
  it("have names and numbers of their own", () => {
    const first = newPassage([]);
    const other = newPassage([{ ...first, name: "passage 2" }]);
    expect([other.name, other.id]).toEqual(["passage 3", 2]);
  });
  it("of a nearest request are taken, and an end that the form has no field for is kept", () => {
    const passages = [{ name: "a", state: { kind: "point" as const, position: [0.5, 0, 0.5], velocity: [0.1, 0, 0] } }];
    const taken = withNearest(FIRST_DRAFT, { passages } as PlanRequest);
    expect(requestOf(taken, "c").passages).toEqual(passages);
    const end = { kind: "joint" as const, positions: [0, -1, 1, 0, 0, 0] };
    expect(requestOf(draftOf({ passages, end } as PlanRequest), "c").end).toEqual(end);
  });
  it("name the field that is no number by its path in the request", () => {
    const lacking = { ...newPassage([]), outputs: [{ ...FIRST_OUTPUT, index: "two" }] };
    const draft = { ...FIRST_DRAFT, isMotion: true, passages: [newPassage([]), lacking] };
    expect(() => requestOf(draft, "c")).toThrow(expect.objectContaining({ path: "passages[1].outputs[0].index" }));
  });
});

describe("a plan that an address names", () => {
  const plan = { id: "p1", cell: "c" } as never;
  it("may be thrown only where it answers the form", () => {
    const same = change(FIRST_STATE, { type: "restored", cell: "c", request: FIRST_DRAFT, plan, answers: true });
    expect([planStanding(same), isArmed(same)]).toEqual(["valid", true]);
    const other = change(FIRST_STATE, { type: "restored", cell: "c", request: FIRST_DRAFT, plan, answers: false });
    expect([planStanding(other), isArmed(other)]).toEqual(["stale", false]);
  });
});

describe("recordings", () => {
  const columns = ["clock_s", ...["q", "planned_q"].flatMap((name) => [0, 1, 2, 3, 4, 5].map((j) => `${name}_${j}_rad`))];
  const row = (t: number, off: number): string => [t, 0, off, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0].join(",");
  it("tell the largest deviation of a joint at each tick", () => {
    const read = deviationOf(`${columns.join(",")}\n${row(0, 0.01)}\n${row(0.002, -0.03)}\n`);
    expect(read).toEqual({ times: [0, 0.002], largest: [0.01, 0.03] });
  });
  it("stand beside each other over the same time", () => {
    const a = { times: [0, 0.002], largest: [1, 2] };
    const b = { times: [0.002, 0.004], largest: [3, 4] };
    expect(together(a, b, 0.002)).toEqual({ times: [0, 0.002, 0.004], values: [[1, 2, null], [null, 3, 4]] });
  });
});
