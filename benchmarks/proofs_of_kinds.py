"""Certified plans of learnt cells, of bodies, at moving targets and of two grippers, and faults in them.

`python -m benchmarks.proofs --kind profile|body|moving|grippers`. Cells and requests are the audit's. A profile is
drawn: speed over the tool's, drag, jitter, and an aim up to 4 cm beside the target. Of two grippers places, balls,
jitters and throws are drawn. Faults are a millimetre, a hundredth, the time in which a target moves by a millimetre, a
tick, or a box in a flight.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count as numbers
from typing import Any

import numpy as np

from benchmarks.proofs_of_grippers import faults_of_grippers, two_throws_in
from learning import cell_with_profile
from planner.answer import aimed_problem, plan_document
from planner.cell import Cell, ThrownBody
from planner.errors import PlannerError
from planner.planning import SearchHints, plan
from planner.request import problem_from_request

QUICK = SearchHints(offers_nearest=False)  # the nearest request is most of a refusal's time
OFF_M = 1e-3
SHARE = 0.01
AIM_M = 0.04  # [m] of an aim beside its target, about as much as learnt ones are at most
Change = Callable[[dict[str, Any], dict[str, Any]], None]  # of a document and a profile


@dataclass(frozen=True, eq=False)
class ToldPlan:
    """A plan as a verifier is given it: name, document, cell and profile, None without one."""

    name: str
    document: dict[str, Any]
    cell: Cell
    profile: dict[str, Any] | None

    def faults(self) -> Iterator[tuple[str, ToldPlan]]:
        """Yields what is wrong, and the plan with that one fault."""
        if self.cell.grippers:
            for name, document, cell in faults_of_grippers(self.document, self.cell):
                yield name, replace(self, document=document, cell=cell)
            return
        for name, change in _changes(self.document, self.profile is not None):
            document = {key: copy.deepcopy(value) for key, value in self.document.items() if key != "trajectory"}
            profile = copy.deepcopy(self.profile)
            change(document, profile or {})
            document["trajectory"] = self.document["trajectory"]
            yield name, replace(self, document=document, profile=profile)


def told_plans(kind: str, count: int, seed: int) -> Iterator[ToldPlan]:
    """Yields certified plans of a kind: profile, body, moving or grippers."""
    from audit.problems import drawn_problem  # by foreign code, which need not be there

    found = 0
    for index in numbers():
        drawn = drawn_problem(seed, index)
        try:
            if kind == "grippers":
                cell, request = two_throws_in(drawn.cell, np.random.default_rng([seed, index, 4]))
            elif drawn.request is not None and _is_of(kind, drawn.kind, drawn.cell):
                cell, request = drawn.cell, drawn.request
            else:
                continue
            told = _planned(f"{kind}/{seed}/{index}/{drawn.kind}", cell, request, kind == "profile", index)
        except PlannerError:
            continue
        yield told
        found += 1
        if found == count:
            return


def _is_of(kind: str, drawn: str, cell: Cell) -> bool:
    """Returns whether a drawn problem is of a kind: one that throws."""
    if kind == "moving":
        return drawn.startswith("moving")
    throws = drawn in ("target", "robust target", "bin", "landing axis", "throw in a chain")
    if kind == "body":
        return isinstance(cell.object, ThrownBody) and (throws or drawn in ("joint", "pose", "point"))
    return throws and drawn != "throw in a chain"


def _planned(name: str, cell: Cell, request: Mapping[str, Any], is_learnt: bool, index: int) -> ToldPlan:
    if not is_learnt:
        made = plan(problem_from_request(request, cell), QUICK)
        return ToldPlan(name, plan_document(made, request, "", ""), cell, None)
    rng = np.random.default_rng([index, 3])
    profile = {
        "id": name,
        "cell_sha256": cell.sha256,
        "lag_s": float(rng.uniform(0.0, 0.03)),
        "delay_s": float(rng.uniform(0.01, 0.08)),
        "jitter_s": float(rng.uniform(0.0005, 0.004)),
        "speed_factor": float(rng.uniform(0.93, 1.03)),
        "drag_coefficient": float(rng.uniform(0.0, 0.6)),
        "outputs": {},
    }
    shift = np.append(rng.uniform(-AIM_M, AIM_M, 2) / np.sqrt(2.0), 0.0)
    made = plan(aimed_problem(problem_from_request(request, cell_with_profile(cell, profile)), shift), QUICK)
    learnt = {"profile": name, "aim": {"shift_m": shift.tolist()}}
    return ToldPlan(name, plan_document(made, request, "", "") | learnt, cell, profile)


def _released(document: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the release of a document's request."""
    request = document["request"]
    return request.get("release") or next(each["state"] for each in request["passages"] if each.get("releases"))


def _changes(document: Mapping[str, Any], is_learnt: bool) -> Iterator[tuple[str, Change]]:
    """Yields faults that a plan can have."""
    release = _released(document)
    if release["kind"] != "target":
        return
    for axis in (0, 1):
        yield f"target off along {'xy'[axis]}", lambda d, _, axis=axis: _add(_released(d)["position"], axis, OFF_M)
    if is_learnt:
        yield "object faster", lambda _, p: p.update(speed_factor=p["speed_factor"] * (1.0 + SHARE))
        yield "aim off", lambda d, _: _add(d["aim"]["shift_m"], 0, OFF_M)
    yield from _of_moving(document, release)
    yield from _of_landing(document, release)


def _of_moving(document: Mapping[str, Any], release: Mapping[str, Any]) -> Iterator[tuple[str, Change]]:
    """Yields faults of a target that moves."""
    v = release.get("velocity")
    speed = 0.0 if v is None else float(np.linalg.norm(v))
    if speed > 0.0:
        late_s = OFF_M / speed
        met_s = document["starts_at_s"] + document["release_time_s"] - release["observed_at_s"]
        yield "started late", lambda d, _: d.update(starts_at_s=d["starts_at_s"] + late_s)
        yield "target faster", lambda d, _: _add(_released(d)["velocity"], 0, OFF_M / abs(met_s))


def _of_landing(document: Mapping[str, Any], release: Mapping[str, Any]) -> Iterator[tuple[str, Change]]:
    """Yields demands of the landing that it keeps all but a hundredth."""
    flight = document["flight"]
    asked = release.get("orientation")
    if asked is not None and document["request"].get("frame", "world") == "world":
        lies = np.asarray(flight["landing_orientation"]["axis"])
        aside = np.cross(lies, np.roll(lies, 1))
        angle = min((1.0 + SHARE) * asked["tolerance_rad"], 0.5 * np.pi)
        turned = np.cos(angle) * lies + np.sin(angle) * aside / np.linalg.norm(aside)
        yield "axis", lambda d, _: _released(d)["orientation"].update(axis=turned.tolist())
    worst = max((each["landing_error_m"] or 0.0 for each in flight["window"]), default=0.0)
    if flight["release_window_s"] > 0.0 and worst > OFF_M:
        yield "tolerance", lambda d, _: d["request"].update(landing_tolerance_m=(1.0 - SHARE) * worst)


def _add(values: list[float], axis: int, by: float) -> None:
    values[axis] += by
