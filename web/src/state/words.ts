// What the page says, in words: states, outcomes, stops and what to do after them, refusals. Pure.

import { edgeWords, mainTime } from "../model/passages";
import type { CellState, CellSummary, Execution, LandingAnswer, Plan, PlanProgress } from "../service/types";
import type { Run } from "./machine";
import { armKind } from "./readiness";

export type Tone = "good" | "bad" | "busy" | "idle";

const NOISE = 1e-9; // of any SI unit: rounding, and shown as none
const SMALL = 1e-4; // below it a power of ten is easier to read
const SUPERSCRIPT = { "-": "⁻", "0": "⁰", "1": "¹", "2": "²", "3": "³", "4": "⁴", "5": "⁵", "6": "⁶", "7": "⁷", "8": "⁸", "9": "⁹" } as const;

/** A number with so many significant digits, without trailing zeros; a dash for none. */
export function figure(value: unknown, digits = 3): string {
  if (typeof value !== "number" || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size < NOISE) return "0";
  if (size < SMALL) return powerOfTen(value, digits);
  const text = size >= 1000 ? value.toFixed(0) : String(Number(value.toPrecision(digits)));
  return text.replace("-", "−");
}

function powerOfTen(value: number, digits: number): string {
  const [mantissa = "", exponent = ""] = value.toExponential(digits - 1).split("e");
  const raised = [...String(Number(exponent))].map((sign) => SUPERSCRIPT[sign as keyof typeof SUPERSCRIPT]).join("");
  return `${String(Number(mantissa)).replace("-", "−")}·10${raised}`;
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
  executor_lost: "The executor was lost during the throw",
  foreign_program: "Another program took over the robot",
  power_off: "The arm lost its power",
  released_early: "The object was let go too early",
  held: "Kept the object: it would have missed",
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
  executor_lost: "See that the arm stands still, then acknowledge.",
  released_early: "Something else changed the gripper's output. Settle who has the robot, then acknowledge.",
  foreign_program: "Somebody else moved this robot. Settle who has it, then acknowledge.",
  not_released: "The gripper's output did not do what it was told. Look at its wiring and who else switches it, then acknowledge.",
  power_off: "Power the arm on and release its brakes on the pendant, then acknowledge.",
  aborted: "The stop did not end in order. Look at the arm, then acknowledge.",
};

interface Ended {
  readonly outcome: string | null;
  readonly reason?: string | null;
  readonly metrics?: unknown;
  readonly dryRun?: boolean;
}

/** What came of an execution: a move that let go of nothing was no throw, and a dry run no move. */
export function outcomeWords({ outcome, reason, metrics, dryRun }: Ended): string {
  const released = (metrics as Readonly<Record<string, unknown>> | null | undefined)?.["released"];
  if (dryRun) return outcome === "completed" ? "Dry run: nothing moved" : `Dry run: ${uncapitalised(stopWords(outcome, reason))}`;
  if (outcome === "completed" && released === false) return "Moved as planned";
  return stopWords(outcome, reason);
}

/** Outcomes have several causes, which the executor's reason tells apart (executor/records/metrics.py, executor/supervision.py). */
function stopWords(outcome: string | null, reason: string | null | undefined): string {
  if (outcome === "late" && isGripperLate(reason)) return "Thrown, but the gripper was told too late";
  if (outcome === "link_lost" && wasMachineSilent(reason)) return "Stopped: no commands were sent for too long";
  return OUTCOME_WORDS[outcome ?? ""] ?? outcome?.replaceAll("_", " ") ?? "";
}

function isGripperLate(reason: string | null | undefined): boolean {
  return /^the gripper command was/.test(reason ?? "");
}

/** Whether this machine was silent, for whatever reason; api/cli/support/summary.py has the same words. */
function wasMachineSilent(reason: string | null | undefined): boolean {
  return /was silent for|no command for|was frozen/.test(reason ?? "");
}

function uncapitalised(text: string): string {
  return `${text[0]?.toLowerCase() ?? ""}${text.slice(1)}`;
}

/** What a person does after a stop; null where nothing is to be done. */
export function adviceAfter(outcome: string | null, reason: string | null | undefined): string | null {
  if (outcome === "late" && isGripperLate(reason)) return GRIPPER_LATE;
  if (outcome === "late" && /the link lost them/.test(reason ?? "")) return ADVICE["link_lost"]!;
  if (outcome === "link_lost" && wasMachineSilent(reason)) return PROBABLY_BUSY;
  if (outcome === "executor_lost" && wasMachineSilent(reason)) return `${ADVICE["executor_lost"]} ${TOO_BUSY}`;
  return ADVICE[outcome ?? ""] ?? null;
}

const TOO_BUSY = "This machine was too busy: end other programs; “fling doctor” judges its timing.";
// A call that does not return may wait for the processor, or for the network.
const PROBABLY_BUSY = "This machine was probably too busy: end other programs, then acknowledge; “fling doctor” judges its timing. If nothing else ran, look at cable, network and controller.";
const GRIPPER_LATE = "This machine was too busy when the gripper was due. End what loads it, then acknowledge; “fling doctor” judges its timing.";

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
  if (!executor) return plain("idle", "No executor", elsewhere(summary), `Start one: fling executor --cell ${summary.name}`);
  const fault = (live?.fault ?? null) as Fault | null;
  const silent = `The executor was last heard of ${agoWords(executor.heartbeat_age_s)} ago: it has ended, or is stalled.`;
  const revive = `See whether its process still runs; if not, start it: fling executor --cell ${summary.name}`;
  if (fault) {
    const headline = stopWords(fault.outcome ?? null, fault.reason) || "Fault";
    const advice = adviceAfter(fault.outcome ?? null, fault.reason) ?? "Look at the robot, then acknowledge.";
    const reasons = [...(fault.reason ? [plainWords(fault.reason)] : []), ...(executor.alive ? [] : [silent])];
    return { tone: "bad", headline, reasons, advice: executor.alive ? advice : `${revive}. ${advice}`, fault: true };
  }
  if (!executor.alive) return plain("bad", "The executor is silent", [silent], revive);
  const robot = (live?.robot ?? {}) as { refusals?: string[]; warnings?: string[]; connected?: boolean };
  if (live?.execution_id) return plain("busy", "Throwing", robot.warnings ?? []);
  const refusals = robot.refusals ?? [];
  if (refusals.length > 0) return plain("bad", "Not ready to move", refusals);
  if (executor.read_only) return plain("idle", "Watching only", ["The executor runs with --read-only."]);
  if (armKind(summary) === "unproven") {
    return plain("idle", "Ready", [...elsewhere(summary), ...(robot.warnings ?? [])]);
  }
  return plain("good", "Ready", robot.warnings ?? []);
}

function elsewhere(summary: CellSummary): readonly string[] {
  if (armKind(summary) !== "unproven") return [];
  return [`Its cell file says “sim”, but ${summary.link_host} is not on this machine: it may be a real arm.`];
}

/** A moment (ISO 8601) on this machine's clock, with its date. */
export function dateWords(at: string): string {
  return new Date(at).toLocaleString(undefined, { day: "numeric", month: "short", year: "numeric", hour: "2-digit", minute: "2-digit", second: "2-digit" });
}

/** A time that has passed [s], as people say it. */
export function agoWords(seconds: number): string {
  if (seconds < 120) return `${Math.round(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 120 ? `${minutes} min` : minutes < 2880 ? `${Math.round(minutes / 60)} h` : `${Math.round(minutes / 1440)} days`;
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
    { text: "Executor reports", ok: live === null ? null : live.executor?.alive === true },
    live?.fault
      ? { text: "A fault is latched: look at the arm, then acknowledge it above", ok: false }
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
  keep_out: "Clear of the surroundings",
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
  flights_apart: "Distance between the objects in the air",
  releases_apart: "Time between the grippers' openings",
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

const JOINT_WORDS: Readonly<Record<string, string>> = {
  shoulder_pan: "base", shoulder_lift: "shoulder", elbow: "elbow", wrist_1: "wrist 1", wrist_2: "wrist 2", wrist_3: "wrist 3",
};

/** The planner's and the executor's own words with joints and checks as people name them; keys of files stay as they are. */
export function plainWords(text: string): string {
  return text.replace(/(?<![\w.])[a-z]+(?:_[a-z0-9]+)+(?![\w.])/g, (name) => {
    const joint = JOINT_WORDS[name.replace(/_joint$/, "")];
    if (joint !== undefined) return joint;
    return name in CONSTRAINT_WORDS ? uncapitalised(constraintWords(name)) : name;
  });
}

/** Names, units and scales of what was measured in an execution. */
const METRICS: Readonly<Record<string, readonly [string, string, number]>> = {
  ticks: ["Ticks", "", 1],
  missed_ticks: ["Ticks that were missed", "", 1],
  ready_s: ["Ready to start after", "s", 1],
  period_p50_s: ["Time between ticks, median", "ms", 1000],
  period_p99_s: ["Time between ticks, 99 % below", "ms", 1000],
  period_max_s: ["Time between ticks, longest", "ms", 1000],
  realtime: ["Real-time scheduling", "", 1],
  tracking_error_max_rad: ["Joint off the plan, at most", "mrad", 1000],
  tracking_error_max_m: ["Tool off the plan, at most", "mm", 1000],
  path_error_max_m: ["Tool off the path, at most", "mm", 1000],
  release_velocity_error_rad_s: ["Joint speed off at the release", "rad/s", 1],
  release_velocity_error_share: ["Joint speed off, of the fastest", "%", 100],
  release_velocity_unexpected_rad_s: ["Beyond what the profile expects", "rad/s", 1],
  gripper_commanded_s: ["Gripper told at", "s", 1],
  gripper_command_late_s: ["Gripper told late by", "ms", 1000],
  gripper_opened_s: ["Object left at", "s", 1],
  gripper_opened_late_s: ["Object left late by", "ms", 1000],
  released: ["Gripper told to open", "", 1],
  landing_error_m: ["Landed off by", "mm", 1000],
  landed_on: ["Landed on", "", 1],
};

/** Everything that was measured in an execution, as names and values. */
export function metricRows(metrics: Readonly<Record<string, unknown>>): readonly (readonly [string, string])[] {
  const known = Object.entries(metrics).filter(([, value]) => value !== null && typeof value !== "object");
  const rows = known.map(([name, value]) => {
    const [label, unit, scale] = METRICS[name] ?? [constraintWords(name), "", 1];
    if (typeof value === "boolean") return [label, value ? "yes" : "no"] as const;
    return [label, typeof value === "number" ? `${figure(value * scale, 4)} ${unit}`.trimEnd() : plainWords(String(value))] as const;
  });
  return [...rows, ...outputRows((metrics["outputs"] ?? []) as Outputs)];
}

type Outputs = NonNullable<NonNullable<Execution["metrics"]>["outputs"]>;

/** When each output of a plan's passages was seen to change. */
function outputRows(outputs: Outputs): (readonly [string, string])[] {
  return outputs.map((each) => {
    const late = each.edge_late_s ?? 0;
    const seen = each.edge_time_s === null ? "not seen" : `after ${each.edge_time_s.toFixed(3)} s, ${figure(1000 * Math.abs(late), 2)} ms ${late < 0 ? "early" : "late"}`;
    return [`${each.passage ?? "Stop"}: ${edgeWords(each)}`, seen] as const;
  });
}

function passedWords(passages: NonNullable<Plan["passages"]>): string {
  const times = passages.map(({ name, time_s }) => `${name} after ${time_s.toFixed(2)} s`);
  return `Passes ${times.join(", ")}`;
}

/** What the plan promises, in a sentence or two. */
export function planWords(plan: Plan): string {
  const flight = plan.flight;
  const release = plan.passages && !plan.release ? passedWords(plan.passages) : `Release after ${mainTime(plan).toFixed(2)} s`;
  if (!flight) return `${release}; at rest after ${plan.duration_s.toFixed(2)} s. Nothing flies.`;
  return (
    `${release} at ${flight.speed_m_s.toFixed(1)} m/s, ${flight.time_of_flight_s.toFixed(2)} s of flight, ` +
    `at rest after ${plan.duration_s.toFixed(2)} s.${typeof plan.starts_at_s === "number" ? ` It starts at ${plan.starts_at_s.toFixed(2)} s of the controller's clock.` : ""}`
  );
}

/** What the search for a plan has come to. */
export function progressWords({ stage, candidates, best_release_time_s: best_s, elapsed_s }: PlanProgress): string {
  if (stage === "queued") return `Waiting for a planner, ${elapsed_s.toFixed(1)} s`;
  const tried = triedWords(candidates);
  if (stage === "nearest") return `Refused; looking for one that works: ${tried}, ${elapsed_s.toFixed(1)} s`;
  return `Searching: ${tried}, ${bestWords(best_s)}, ${elapsed_s.toFixed(1)} s`;
}

/** What a search had come to when a person ended it. */
export function cancelledWords({ stage, candidates, best_release_time_s: best_s, elapsed_s }: PlanProgress): string {
  const spent = `Cancelled after ${elapsed_s.toFixed(1)} s`;
  if (stage === "queued") return `${spent}, before the search began.`;
  if (stage === "nearest") return `${spent}: the request had been refused; the search for one that works was cut short.`;
  return `${spent}: ${triedWords(candidates)}, ${bestWords(best_s)}.`;
}

function triedWords(candidates: number): string {
  return `${candidates} candidate${candidates === 1 ? "" : "s"} tried`;
}

function bestWords(best_s: number | null): string {
  return best_s === null ? "nothing certified yet" : `best release at ${best_s.toFixed(3)} s`;
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
  const released = metrics["released"] === true;
  return [
    { label: "Landing error", value: length(typeof measured === "number" ? measured : observed_m), note: "" },
    {
      label: "Release speed",
      value: speed === undefined || !released ? "–" : `${figure(speed)} m/s`,
      note: released && typeof share === "number" ? `${figure(share * 100, 2)} % off` : "",
    },
    timeliness(run.outcome, metrics),
  ];
}

/** How well commands kept their time: after a stop for lateness, what was late. */
function timeliness(outcome: string | null, metrics: Readonly<Record<string, unknown>>): KeyNumber {
  const [missed, gripper, gap] = ["missed_ticks", "gripper_command_late_s", "period_max_s"].map((name) => metrics[name]);
  const ms = (seconds: number): string => `${figure(seconds * 1000, 2)} ms`;
  if (outcome === "late" && missed === 0) {
    if (typeof gripper === "number" && gripper > 0) return { label: "Gripper command late", value: ms(gripper), note: "" };
    if (typeof gap === "number") return { label: "Longest gap", value: ms(gap), note: "" };
  }
  return { label: "Missed ticks", value: typeof missed === "number" ? String(missed) : "–", note: "" };
}

/** What somebody reported of a landing. */
export function landingWords({ position, std_m, result, radius_m }: LandingAnswer): string {
  if (position !== null) {
    const place = position.map((x) => figure(Number(x.toFixed(3)), 4)).join(", ");
    return `at (${place})${std_m ? ` ± ${length(std_m)}` : ""}`;
  }
  const target = `the target’s ${length(radius_m)}`;
  return { hit: `hit, within ${target}`, edge: `on the edge of ${target}`, miss: `miss, beyond ${target}` }[result ?? ""] ?? "nothing";
}
