// What the page says, in words: states, outcomes, stops and what to do after them, refusals. Pure.

import type { CellState, CellSummary, Execution, LandingAnswer, Plan } from "../service/types";
import type { Run } from "./machine";

export type Tone = "good" | "bad" | "busy" | "idle";

/** A number with so many significant digits, without trailing zeros; a dash for none. */
export function figure(value: unknown, digits = 3): string {
  if (typeof value !== "number" || !Number.isFinite(value)) return "–";
  const text = Math.abs(value) >= 1000 ? value.toFixed(0) : String(Number(value.toPrecision(digits)));
  return text.replace("-", "−");
}

/** A value beside the limit that it breaks, with as many digits as tell them apart. */
export function against(value: number, limit: number, unit: string): string {
  const digits = [3, 4, 5, 6].find((count) => figure(value, count) !== figure(limit, count)) ?? 3;
  return `${figure(value, digits)} ${unit} against a limit of ${figure(limit, digits)} ${unit}`;
}

/** A length in the unit people would say. */
export function length(metres: unknown): string {
  if (typeof metres !== "number") return "–";
  return Math.abs(metres) < 1 ? `${figure(metres * 1000, metres < 0.01 ? 2 : 3)} mm` : `${figure(metres)} m`;
}

export const PHASE_WORDS: Readonly<Record<string, string>> = {
  queued: "Queued",
  preparing: "Preflight",
  approaching: "To the start",
  streaming: "Throwing",
  braking: "Braking",
  finished: "Finished",
};

export const OUTCOME_WORDS: Readonly<Record<string, string>> = {
  completed: "Thrown as planned",
  aborted: "Stopped on request",
  refused: "Not started: preflight refused",
  protective_stop: "Protective stop",
  emergency_stop: "Emergency stop",
  link_lost: "Connection to the robot lost",
  late: "Stopped: commands came too late",
  tracking: "Stopped: the arm left the plan",
  executor_lost: "The executor ended during the throw",
  foreign_program: "Another program took over the robot",
  power_off: "The arm lost its power",
  held: "Kept the object: it would have missed",
  released_early: "Stopped: the gripper opened by itself",
  not_released: "The gripper did not let go",
};

/** What a person does after each kind of stop, before acknowledging it. */
export const ADVICE: Readonly<Record<string, string>> = {
  protective_stop:
    "Look at the arm and remove what it met. Clear the protective stop on the pendant, then acknowledge it here.",
  emergency_stop:
    "Find out why it was pressed. Release the button, power the arm on and release its brakes on the pendant, then acknowledge.",
  link_lost: "Look at cable, network and controller. When the robot reports again, acknowledge.",
  late: "This machine was too busy to send a command every tick. End what loads it, then acknowledge; “fling doctor” judges its timing.",
  tracking: "The arm did not follow its commands. Look for a collision, a wrong payload or a wrong tool, then acknowledge.",
  executor_lost: "The executor's process ended. See that the arm stands still, start the executor again, then acknowledge.",
  foreign_program: "Somebody else moved this robot. Settle who has it, then acknowledge.",
  released_early: "Another client switches the gripper's output. Find it, look where the object went, then acknowledge.",
  not_released: "The gripper's output did not do what it was told. Look at its wiring and who else switches it, then acknowledge.",
  power_off: "Power the arm on and release its brakes on the pendant, then acknowledge.",
  aborted: "The stop did not end in order. Look at the arm, then acknowledge.",
};

/** What came of an execution: a move that let go of nothing was no throw. */
export function outcomeWords({ outcome, metrics }: { outcome: string | null; metrics?: unknown }): string {
  const released = (metrics as Readonly<Record<string, unknown>> | null | undefined)?.["released"];
  if (outcome === "completed" && released === false) return "Moved as planned";
  return OUTCOME_WORDS[outcome ?? ""] ?? outcome ?? "";
}

export function outcomeTone(outcome: string | null): Tone {
  if (outcome === null) return "busy";
  return outcome === "completed" ? "good" : outcome === "aborted" || outcome === "held" ? "idle" : "bad";
}

interface Fault {
  readonly outcome?: string;
  readonly reason?: string;
}

interface CellWords {
  readonly tone: Tone;
  readonly headline: string;
  readonly reasons: readonly string[];
  readonly advice: string | null;
  readonly fault: boolean;
}

/** The state of a cell in words, and what to do about it. */
export function cellWords(summary: CellSummary, live: CellState | null): CellWords {
  const plain = (tone: Tone, headline: string, reasons: readonly string[] = [], advice: string | null = null): CellWords => ({
    tone, headline, reasons, advice, fault: false,
  });
  if (summary.error) return plain("bad", "Cell file refused", [summary.error], "Repair the cell file; “fling cell check” judges it.");
  const executor = live?.executor ?? summary.executor;
  if (!executor) return plain("idle", "No executor", [], `Start one: fling executor --cell ${summary.name}`);
  const fault = (live?.fault ?? null) as Fault | null;
  if (fault) {
    const headline = OUTCOME_WORDS[fault.outcome ?? ""] ?? "Fault";
    const advice = ADVICE[fault.outcome ?? ""] ?? "Look at the robot, then acknowledge.";
    return { tone: "bad", headline, reasons: fault.reason ? [fault.reason] : [], advice, fault: true };
  }
  if (!executor.alive) return plain("bad", "The executor is gone", [], `Start it again: fling executor --cell ${summary.name}`);
  const robot = (live?.robot ?? {}) as { refusals?: string[]; warnings?: string[]; connected?: boolean };
  if (live?.execution_id) return plain("busy", "Throwing", robot.warnings ?? []);
  const refusals = robot.refusals ?? [];
  if (refusals.length > 0) return plain("bad", "Not ready to move", refusals);
  if (executor.read_only) return plain("idle", "Watching only", ["The executor runs with --read-only."]);
  return plain("good", "Ready", robot.warnings ?? []);
}

interface PreflightItem {
  readonly text: string;
  readonly ok: boolean | null; // null: not known yet
}

/** What has to be in order before the arm moves: what the executor reports as in the way, by subject. */
export function preflight(live: CellState | null, plan: Plan | null): readonly PreflightItem[] {
  const robot = (live?.robot ?? null) as { refusals?: string[] } | null;
  const refusals = [...(robot?.refusals ?? [])];
  const items: PreflightItem[] = [
    { text: "Executor runs", ok: live === null ? null : live.executor?.alive === true },
    live?.fault
      ? { text: "A fault is latched: look at the arm, then acknowledge it under Robots", ok: false }
      : { text: "No fault is latched", ok: live === null ? null : true },
  ];
  for (const [text, pattern] of SUBJECTS) {
    const found = refusals.filter((reason) => pattern.test(reason));
    for (const reason of found) refusals.splice(refusals.indexOf(reason), 1);
    if (found.length > 0) items.push(...found.map((reason) => ({ text: reason, ok: false })));
    else items.push({ text, ok: robot === null ? null : true });
  }
  items.push(...refusals.map((reason) => ({ text: reason, ok: false })));
  items.push({ text: "Plan is certified", ok: plan?.certificate.valid ?? null });
  return items;
}

/** Subjects of the executor's refusals, by the words that they are told in (executor/preflight.py). */
const SUBJECTS: readonly (readonly [string, RegExp])[] = [
  ["Robot is the cell's", /^wrong robot|^kinematics/],
  ["Controller is connected, in remote control", /controller at|remote control|dashboard/],
  ["Arm is powered, brakes released", /^the robot is /],
  ["Safety is normal, speed at 100 %", /^safety|speed slider/],
  ["Arm is at rest", /arm is moving/],
  ["Payload and tool as in the cell", /payload|tool centre point|kinematic/],
];

const CONSTRAINT_WORDS: Readonly<Record<string, string>> = {
  tcp_speed: "Tool speed",
  joint_position: "Joint position",
  joint_velocity: "Joint velocity",
  joint_acceleration: "Joint acceleration",
  joint_jerk: "Joint jerk",
  joint_torque: "Joint torque",
  floor: "Distance to the floor",
  keep_in: "Inside its box",
  keep_out: "Clear of the boxes",
  self_collision: "Distance between the arm's links",
  singularity_distance: "Distance to a singularity",
  release_position: "Release position",
  release_velocity: "Release velocity",
  landing: "Landing error",
  landing_window: "Landing in the release window",
  end_at_rest: "At rest in the end",
  continuity: "Continuity",
  start: "Start",
  reach: "Reach",
  flight_clearance: "Clearance of the flight",
  grip_acceleration: "Acceleration in the grip",
  opening_direction: "Opening direction",
  elbow_speed: "Elbow speed",
  momentum: "Momentum",
  power: "Power",
  stopping_time: "Time to standstill",
  stopping_distance: "Distance to standstill",
  way_home: "Way home",
  hit_probability: "Hit probability",
  min_hit_probability: "Hit probability",
};

export function constraintWords(name: string): string {
  return CONSTRAINT_WORDS[name] ?? name.replaceAll("_", " ").replace(/^./, (first) => first.toUpperCase());
}

/** What the plan promises, in a sentence or two. */
export function planWords(plan: Plan): string {
  const flight = plan.flight;
  const release = `Release after ${plan.release_time_s.toFixed(2)} s`;
  if (!flight) return `${release}; at rest after ${plan.duration_s.toFixed(2)} s. Nothing flies.`;
  return (
    `${release} at ${flight.speed_m_s.toFixed(1)} m/s, ${flight.time_of_flight_s.toFixed(2)} s of flight, ` +
    `at rest after ${plan.duration_s.toFixed(2)} s.`
  );
}

/** Which back end found the plan, how fast, and whether the time limit passed before the end of the search. */
export function foundWords(plan: Plan): string {
  const { solve_time_s: took, status } = plan.solver;
  const ended = status.endsWith("time_limit ended the search"); // planner.errors.CUT_SHORT
  const more = ended ? " Its time limit ended the search: with more time the release may be sooner, or the aim better." : "";
  return `Found by ${plan.backend} in ${figure(took, 2)} s.${more}`;
}

/** What the plan holds for a release that is not on time. */
export function timingWords(plan: Plan): string | null {
  const flight = plan.flight;
  if (!flight) return null;
  const robust = flight.release_window_s > 0 && flight.landing_tolerance_m > 0;
  const { early, late } = flight.landing_shift_10ms_m;
  const shift = early === null || late === null ? "" : ` 10 ms early or late moves the landing ${length(early)} or ${length(late)}.`;
  if (!robust) return `Planned for a release on time alone.${shift}`;
  const window = figure(flight.release_window_s * 1000, 2);
  return `Up to ${window} ms early or late it lands within ${length(flight.landing_tolerance_m)}.${shift}`;
}

interface KeyNumber {
  readonly label: string;
  readonly value: string;
  readonly note: string;
}

/** The three numbers that matter of an execution that has ended. */
export function keyNumbers(run: Run | Execution, observed_m: number | null, plan: Plan | null): readonly KeyNumber[] {
  const metrics = (run.metrics ?? {}) as Readonly<Record<string, unknown>>;
  const measured = metrics["landing_error_m"];
  const share = metrics["release_velocity_error_share"];
  const speed = plan?.flight?.speed_m_s;
  const missed = metrics["missed_ticks"];
  const released = metrics["released"] === true;
  return [
    { label: "Landing error", value: length(typeof measured === "number" ? measured : observed_m), note: "" },
    {
      label: "Release speed",
      value: speed === undefined || !released ? "–" : `${figure(speed)} m/s`,
      note: released && typeof share === "number" ? `${figure(share * 100, 2)} % off` : "",
    },
    { label: "Missed ticks", value: typeof missed === "number" ? String(missed) : "–", note: "" },
  ];
}

/** What somebody reported of a landing. */
export function landingWords({ position, std_m, result, radius_m }: LandingAnswer): string {
  if (position !== null) {
    const place = position.slice(0, 2).map((x) => figure(Number(x.toFixed(3)), 4)).join(", ");
    return `at (${place})${std_m ? ` ± ${length(std_m)}` : ""}`;
  }
  const target = `the target’s ${length(radius_m)}`;
  return { hit: `hit, within ${target}`, edge: `on the edge of ${target}`, miss: `miss, beyond ${target}` }[result ?? ""] ?? "nothing";
}
