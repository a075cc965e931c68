// The form's text as a request and back, curves, spreads and server-sent events.

import { describe, expect, it } from "vitest";

import { bindingCheck, jerkOf, relativeMargin } from "../src/curves/quantities";
import { poseOfRows } from "../src/model/poses";
import { requestLine } from "../src/docs/schema";
import { parseEvents } from "../src/service/events";
import type { Check, Nearest } from "../src/service/types";
import { FIRST_DRAFT, previewOf, requestOf, withNearest } from "../src/state/draft";
import { InvalidDraft } from "../src/state/numbers";
import { toolAt } from "../src/state/state-draft";
import { ellipseOf } from "../src/state/scatter";
import { figure, length, preflight } from "../src/state/words";
import { shortened } from "../src/views/fields";

describe("the request", () => {
  it("takes the tool's pose from where the robot stands, in the world", () => {
    const pose = poseOfRows([[0, -1, 0, 0.5], [1, 0, 0, -0.25], [0, 0, 1, 0.75], [0, 0, 0, 1]]); // a quarter turn about z
    const draft = { ...FIRST_DRAFT, kind: "pose" as const, frame: "base" as const };
    const asked = requestOf({ ...draft, ...toolAt(draft, pose) }, "ur5e-sim");
    expect(asked.frame).toBe("world");
    expect(asked.release).toMatchObject({ pose: { position: [0.5, -0.25, 0.75], rotation_vector: [0, 0, 1.5708] } });
    const other = { ...draft, orientation: "quaternion" as const };
    expect(toolAt(other, pose).quaternion?.map(Number)).toEqual([0, 0, 0.707107, 0.707107]);
  });

  it("leaves out what was left empty", () => {
    expect(requestOf(FIRST_DRAFT, "ur5e-sim")).toEqual({
      cell: "ur5e-sim", release: { kind: "target", position: [1.2, 0.3, 0] }, frame: "world", backend: "auto",
    });
  });
  it("has every kind of release", () => {
    expect(requestOf({ ...FIRST_DRAFT, kind: "joint" }, "c").release).toMatchObject({ kind: "joint", velocities: [0.8, 0.6, -0.5, 0.3, 0, 0] });
    expect(requestOf({ ...FIRST_DRAFT, kind: "point" }, "c").release).toMatchObject({ kind: "point", velocity: [0.8, 0.3, 0.6] });
    expect(requestOf({ ...FIRST_DRAFT, kind: "pose" }, "c").release).toMatchObject({ kind: "pose", pose: { rotation_vector: [0, 1.57, 0] } });
    expect(requestOf({ ...FIRST_DRAFT, bin: true }, "c").release).toMatchObject({ opening: { radius_m: 0.12, rim_height_m: 0.2 } });
  });
  it("takes one limit or six", () => {
    expect(requestOf({ ...FIRST_DRAFT, velocityLimit: "2.5" }, "c").limits).toEqual({ velocity: 2.5 });
    expect(requestOf({ ...FIRST_DRAFT, jerkLimit: "1, 2, 3, 4, 5, 6" }, "c").limits).toEqual({ jerk: [1, 2, 3, 4, 5, 6] });
    expect(() => requestOf({ ...FIRST_DRAFT, jerkLimit: "1 2" }, "c")).toThrow(InvalidDraft);
  });
  it("names text that is no number", () => {
    expect(() => requestOf({ ...FIRST_DRAFT, target: ["1.2", "left", "0"] }, "c")).toThrow(new InvalidDraft("target 2", "left", "release.position[1]"));
    try {
      requestOf({ ...FIRST_DRAFT, velocityLimit: "2 x" }, "c");
    } catch (error) {
      expect((error as InvalidDraft).path).toBe("limits.velocity"); // where the field is marked
    }
    expect(() => requestOf({ ...FIRST_DRAFT, target: ["1.2", "", "0"] }, "c")).toThrow("a number is needed");
  });
  it("is previewed by the fast back end, on time alone", () => {
    expect(previewOf({ ...FIRST_DRAFT, window: "0.02" }, "c")).toMatchObject({ backend: "ruckig", release_window_s: 0 });
  });
  it("takes what is nearest exactly, and shows it shortened", () => {
    const nearest = { release: { kind: "target", position: [2.1812136393712955, 0.1558009742408068, 0] }, release_window_s: 0.004921875 } as Nearest;
    const taken = withNearest({ ...FIRST_DRAFT, maxSpeed: "3" }, nearest);
    expect(requestOf(taken, "c").release).toMatchObject({ position: [2.1812136393712955, 0.1558009742408068, 0], max_release_speed_m_s: 3 });
    expect(requestOf(taken, "c").release_window_s).toBe(0.004921875);
    expect(shortened(taken.target[0] ?? "")).toBe("2.1812");
  });
});

describe("curves and margins", () => {
  const check = (name: string, value: number, limit: number, margin: number): Check => ({ name, value, limit, margin, unit: "", at_s: 0, ok: true });
  it("find the limit that binds, whichever side it limits", () => {
    const checks = [check("joint_velocity", 2.7, 3, 0.3), check("floor", 0.021, 0.02, 0.001), check("continuity", 0, 1e-7, 0)];
    expect(relativeMargin(checks[0]!)).toBeCloseTo(0.1);
    expect(bindingCheck(checks)?.name).toBe("floor");
  });
  it("have the jerk as the change of the acceleration", () => {
    expect(jerkOf([[0], [1], [3]], 500)).toEqual([[500], [1000], [0]]);
  });
});

describe("spread of landings", () => {
  it("is that of a known distribution", () => {
    const points: [number, number][] = [[0.03, 0.03], [-0.03, -0.03], [0.01, -0.01], [-0.01, 0.01]];
    const spread = ellipseOf(points);
    expect(spread?.turn_deg).toBeCloseTo(45);
    expect(spread?.axes[0]).toBeCloseTo(2 * Math.sqrt((2 * 0.0018) / 3));
    expect(spread?.axes[1]).toBeCloseTo(2 * Math.sqrt((2 * 0.0002) / 3));
    expect(ellipseOf(points.slice(0, 2))).toBeNull();
  });
});

describe("events", () => {
  it("are read from a stream that is cut anywhere", () => {
    const text = 'retry: 500\n\nid: 7\nevent: state\ndata: {"state":"queued"}\n\n: keep-alive\n\nid: 8\nevent: tele';
    const { events, rest } = parseEvents(text);
    expect(events).toEqual([{ id: 7, kind: "state", data: { state: "queued" } }]);
    expect(parseEvents(`${rest}metry\ndata: {"clock_s":0.1}\n\n`).events).toEqual([{ id: 8, kind: "telemetry", data: { clock_s: 0.1 } }]);
  });
});

describe("words", () => {
  it("give numbers as people read them", () => {
    expect([figure(0.97314), figure(-1234.5), figure(null), length(0.000973), length(1.2)]).toEqual(["0.973", "−1235", "–", "0.97 mm", "1.2 m"]);
  });
  it("keep every reason of the executor", () => {
    const reasons = ["the speed slider is at 50 %: a throw needs 100 %", "something new is wrong"];
    const items = preflight({ executor: { alive: true }, fault: null, robot: { refusals: reasons } } as never, null);
    expect(items.filter((item) => item.ok === false).map((item) => item.text)).toEqual(reasons);
  });
  it("put the parameters of a call where they belong", () => {
    const parameters = [{ name: "id", in: "path" }, { name: "limit", in: "query" }, { name: "accept", in: "header" }] as const;
    expect(requestLine("/plans/{id}", parameters, { id: "a/b", limit: "3", accept: "text/csv" })).toEqual({
      address: "/plans/a%2Fb?limit=3", headers: { accept: "text/csv" },
    });
  });
});
