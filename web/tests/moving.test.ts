import { expect, test } from "vitest";

import { MovingTarget } from "../src/model/moving";
import { poseOfRows } from "../src/model/poses";
import type { Plan } from "../src/service/types";
import { FIRST_DRAFT, requestOf } from "../src/state/draft";
import { InvalidDraft } from "../src/state/numbers";
import { throwLabel } from "../src/state/machine";
import { planWords } from "../src/state/words";

const BASE = poseOfRows([[0, -1, 0, 0.5], [1, 0, 0, 0], [0, 0, 1, 0.2], [0, 0, 0, 1]]); // turned by 90 degrees
const BELT = { kind: "target", position: [1, 0, 0], velocity: [0, 0.2, 0], observed_at_s: 100, opening: { radius_m: 0.1, rim_height_m: 0.2 } };
const planned = (request: object, starts_at_s: number | null = 103): Plan => ({ request, starts_at_s }) as unknown as Plan;

test("a target that moves is where the plan's clock says", () => {
  const target = MovingTarget.of(planned({ release: BELT }), BASE)!;
  expect(target.at(0)).toEqual([1, expect.closeTo(0.6), 0]);
  expect(target.at(1.5)).toEqual([1, expect.closeTo(0.9), 0]);
  expect(target.opening).toEqual(BELT.opening);
});

test("of passages it is that of the one that releases", () => {
  const passages = [{ state: { kind: "point", position: [0, 0, 1], velocity: [1, 0, 0] } }, { state: BELT, releases: true }];
  expect(MovingTarget.of(planned({ passages }), BASE)!.at(0)).toEqual([1, expect.closeTo(0.6), 0]);
});

test("what is stated in the frame of the base turns with it", () => {
  const target = MovingTarget.of(planned({ release: BELT, frame: "base" }), BASE)!;
  expect(target.velocity.map((v) => Number(v.toFixed(9)))).toEqual([-0.2, 0, 0]);
  expect(target.at(0).map((x) => Number(x.toFixed(9)))).toEqual([-0.1, 1, 0.2]);
});

test("a target that stands is the request's", () => {
  expect(MovingTarget.of(planned({ release: { kind: "target", position: [1, 0, 0] } }, null), BASE)).toBeNull();
  expect(MovingTarget.of(planned({ release: { kind: "point", position: [1, 0, 0], velocity: [1, 0, 0] } }, null), BASE)).toBeNull();
});

test("a plan says where it meets its target, and when it starts", () => {
  const flight = { landing_point: [1, 0.8, 0], speed_m_s: 2, time_of_flight_s: 0.7 };
  const plan = { ...planned({ release: BELT }), cell: "c", duration_s: 1, release_time_s: 0.4, flight } as unknown as Plan;
  expect(throwLabel(plan, 0)).toBe("Throw on c to (1.00, 0.80)");
  expect(planWords(plan)).toContain("It starts at 103.00 s of the controller's clock.");
  expect(throwLabel({ ...plan, starts_at_s: null }, 0)).toBe("Throw on c to (1.00, 0.00)");
});

test("a target is seen when the form says, or now on the controller's clock", () => {
  const draft = { ...FIRST_DRAFT, moves: true, targetVelocity: ["0", "0.2"] };
  expect(requestOf({ ...draft, observedAt: "7" }, "c", 50)).toMatchObject({ release: { velocity: [0, 0.2, 0], observed_at_s: 7 }, starts_not_before_s: 17 });
  expect(requestOf({ ...draft, startsAfter: "2" }, "c", 50.0004)).toMatchObject({ release: { observed_at_s: 50 }, starts_not_before_s: 52 });
  expect(() => requestOf(draft, "c")).toThrow(InvalidDraft);
  expect(requestOf(FIRST_DRAFT, "c", 50)).not.toHaveProperty("starts_not_before_s");
});
