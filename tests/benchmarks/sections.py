"""The sections of the report: each a few lines of Markdown from the rows."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tests.benchmarks.audit import Audit
from tests.benchmarks.peers import PEERS
from tests.benchmarks.peers.sdu_method import Tally
from tests.benchmarks.sdu import table
from tests.benchmarks.statistics import Summary, quantiles
from tests.benchmarks.task import Row

REFUSED = ("unreachable", "too-fast")


def ratios(lines: Sequence[Summary]) -> list[str]:
    """Returns release times and shares."""
    head = [
        "set",
        "back end",
        "certified",
        "of feasible",
        "undecided",
        "to Ruckig p10 / p50 / p90",
        "to bound p50 / p90",
        "on ticks p50 / p90",
    ]
    body = [
        [
            s.group,
            s.backend,
            percent(s.share),
            f"{s.certified} / {s.feasible}",
            str(s.drawn - s.feasible),
            numbers(s.to_ruckig),
            numbers(s.to_bound, 4),
            numbers(s.to_bound_tick, 4),
        ]
        for s in lines
        if not s.group.startswith("sdu")
    ]
    return table_of(head, body)


def times(lines: Sequence[Summary]) -> list[str]:
    """Returns how long plans and certificates take."""
    head = ["set", "back end", "plan p50 / p90 / p99 ms", "cpu p50 / p90 / p99 ms", "certificate p50 / p90 ms"]
    body = [[s.group, s.backend, milli(s.solve_s), milli(s.cpu_s), milli(s.certificate_s)] for s in lines]
    return table_of(head, body)


def windows(lines: Sequence[Summary]) -> list[str]:
    """Returns landing errors around the release."""
    head = ["set", "back end", "±10 ms p50 / p90 mm", "±20 ms p50 / p90 mm", "±30 ms p50 / p90 mm"]
    chosen = [
        s for s in lines if s.group.startswith(("target", "robust")) and s.backend in ("ruckig", "casadi", "auto")
    ]
    body = [[s.group, s.backend, *(milli(s.window_m[w], 1) for w in ("10", "20", "30"))] for s in chosen]
    note = "Worst landing error if the object leaves that much early or late; `robust` asks for 5 mm within ±20 ms."
    return [note, "", *table_of(head, body)]


def refusals(rows: Sequence[Row]) -> list[str]:
    """Returns how fast and how well impossible problems are answered."""
    head = ["set", "refused", "answer p50 / p90 / max ms", "nearest certifies", "nearest wrong", "no nearest"]
    body = []
    for group in REFUSED:
        own = [row for row in rows if row.group == group and row.backend == "auto"]
        refused = [row for row in own if row.outcome == "infeasible"]
        kinds = [sum(row.nearest == kind for row in refused) for kind in ("certified", "wrong", "none")]
        times = quantiles([row.solve_s for row in own], 50, 90, 100)
        body.append([group, f"{len(refused)} / {len(own)}", milli(times), *map(str, kinds)])
    return table_of(head, body)


def sdu(rows: Sequence[Row], rebuilt: dict[str, Tally]) -> list[str]:
    """Targets and pairs certified, beside the project's own numbers and its method rebuilt."""
    head = ["part", "who", "targets", "pairs", "time p50 ms"]
    body = []
    for part in ("near", "far"):
        facts = table()[part]
        own_targets = next(v for k, v in facts.items() if k.startswith("source_hits"))["5 rad/s2"]
        own_pairs = facts["source_clean_pairs_of_2800"]["5 rad/s2"]
        count = len(facts["targets"])
        body.append([part, "the project's report, 5 rad/s²", f"{own_targets} / {count}", f"{own_pairs} / 2800", ""])
        if part in rebuilt:
            t = rebuilt[part]
            body.append(
                [
                    part,
                    "its method rebuilt (no jerk, torque, collision limits)",
                    f"{t.targets} / {t.of_targets}",
                    f"{t.pairs} / {t.of_pairs}",
                    f"{1000 * t.pair_s:.1f}",
                ]
            )
        for backend in dict.fromkeys(row.backend for row in rows if row.group == f"sdu-{part}"):
            body.append([part, f"fling {backend}", *_sdu_shares(rows, part, backend)])
    note = (
        "Targets at 5 rad/s², elevation at 22.5° or more, jerk (500 rad/s³), torque, self-collision, singularity and "
        "box limits. Pairs fix the release point as well; the quick run leaves them out."
    )
    return [note, "", *table_of(head, body)]


def _sdu_shares(rows: Sequence[Row], part: str, backend: str) -> list[str]:
    targets = [row for row in rows if row.group == f"sdu-{part}" and row.backend == backend]
    pairs = [row for row in rows if row.group == f"sdu-{part}-pairs" and row.backend == backend]
    shown = f"{sum(r.certified for r in pairs)} / {len(pairs)}" if pairs else "–"
    time = milli(quantiles([row.solve_s for row in targets], 50))
    return [f"{sum(r.certified for r in targets)} / {len(targets)}", shown, time]


def peers(rows: Sequence[Row]) -> list[str]:
    """The peers and our back ends on the problems that the peer was given."""
    head = [
        "peer",
        "certified",
        "auto on the same",
        "auto's release time over the peer's p10 / p50 / p90",
        "peer's time p50 / p90 ms",
        "auto p50 / p90 ms",
        "fails its certificate by",
    ]
    auto = {row.task: row for row in rows if row.backend == "auto"}
    body = []
    for name, peer in PEERS.items():
        own = [row for row in rows if row.backend == name and row.task in auto]
        if not own:
            body.append([peer.title, "not installed", *[""] * 5])
            continue
        both = [(auto[r.task].release_time_s, r.release_time_s) for r in own if r.certified and auto[r.task].certified]
        reasons = sorted({word for r in own if r.outcome == "invalid" for word in r.reason.split(", ")})
        same = [auto[r.task] for r in own]
        body.append(
            [
                peer.title,
                f"{sum(r.certified for r in own)} / {len(own)}",
                f"{sum(a.certified for a in same)} / {len(same)}",
                numbers(quantiles([a / b for a, b in both], 10, 50, 90)),
                milli(quantiles([r.solve_s for r in own], 50, 90)),
                milli(quantiles([a.solve_s for a in same], 50, 90)),
                ", ".join(reasons),
            ]
        )
    note = (
        "Poses. Peers get our three best postures in turn; their brake is Ruckig's and not counted in their time. "
        "Drake has joint limits up to the jerk and nothing else to obey; the IPOPT program has torques, floor, tool "
        "speed and singularities too, starts cold, and runs interpreted. Timing a path by TOPP-RA is Fling's own back "
        "end `toppra`, in the tables above."
    )
    return [note, "", *table_of(head, body)]


def audit(judged: Audit) -> list[str]:
    """Returns what the second judge found."""
    text = (
        f"{judged.judged:,} certified plans of other random problems were judged by other libraries: poses, points, "
        "targets and robust targets on four arms, and every kind of release in varied cells (bases turned, tilted and "
        "raised, long tools off the axis, heavy objects, boxes to stay in and out of); back end auto, every fourth by "
        f"ruckig; {judged.refused:,} more were refused. Pinocchio judged kinematics, singularities and, with MuJoCo, "
        "torques (4 ms); coal the distances (8 ms); MuJoCo simulated the flight: "
        f"**{len(judged.wrong)} wrong**."
    )
    return [text, *(f"- `{name}`: {fault}" for name, fault in judged.wrong)]


def table_of(head: Sequence[str], body: Sequence[Sequence[str]]) -> list[str]:
    """Returns a Markdown table."""
    rule = ["---"] * len(head)
    return ["| " + " | ".join(row) + " |" for row in (head, rule, *body)]


def numbers(values: Sequence[float], digits: int = 3) -> str:
    """Returns numbers for a cell of a table; a dash where there are none."""
    return " / ".join("–" if math.isnan(v) else f"{v:.{digits}f}" for v in values)


def milli(values: Sequence[float], digits: int = 0) -> str:
    """Returns thousandths."""
    return numbers([1000.0 * v for v in values], digits)


def percent(share: float) -> str:
    """Returns a share as a percentage."""
    return "–" if math.isnan(share) else f"{100.0 * share:.1f} %"
