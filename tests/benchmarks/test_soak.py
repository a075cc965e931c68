"""What a soak is judged by, and what its hostile clients send."""

from __future__ import annotations

import pytest

from benchmarks.soak.clients import Tally
from benchmarks.soak.hostile import requests
from benchmarks.soak.station import Usage
from benchmarks.soak.verdict import faults, growth

STEADY = [1, 3, 2, 3, 1, 2, 3, 2] * 10


def usages(memory: list[float] | None = None, descriptors: list[int] | None = None) -> list[Usage]:
    counts = descriptors or [20 + up for up in STEADY]
    megabytes = memory or [100.0 + up for up in STEADY]
    return [Usage("service", 5.0 * i, megabytes[i], counts[i], 9, 4) for i in range(len(STEADY))]


def test_load_that_comes_and_goes_is_no_growth():
    assert growth(usages(), STEADY) == []


def test_a_descriptor_lost_now_and_then_is_growth():
    leaking = [20 + up + i // 10 for i, up in enumerate(STEADY)]
    assert growth(usages(descriptors=leaking), STEADY) == ["service: descriptors grew from at most 26 to at least 27"]


def test_memory_may_fill_caches_and_no_more():
    assert growth(usages(memory=[80.0 + min(i, 20) for i in range(80)]), STEADY) == []
    (found,) = growth(usages(memory=[100.0 + i for i in range(80)]), STEADY)
    assert found == "service: memory grew from 130 MB to 170 MB"


def test_shared_memory_that_is_left_behind_is_growth():
    (found,) = growth(usages(), [i // 8 for i in range(80)])
    assert found.startswith("shared memory")


def good() -> Tally:
    tally = Tally()
    tally.statuses.update({200: 10, 503: 2, 409: 1})
    tally.outcomes["completed"] = 3
    tally.stops_s += [0.01, 0.9]
    return tally


def test_a_good_soak_has_no_faults():
    assert faults(good(), {"422": 5, "503": 1, "0": 2}) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda tally: tally.statuses.update({500: 1}), "status 500, 1 times"),
        (lambda tally: tally.stops_s.append(1.5), "1 of 3 stops took over 1 s, 1.5 s at most"),
        (lambda tally: tally.lost.append("plan 7"), "plan 7"),
        (lambda tally: tally.outcomes.clear(), "no throw was completed"),
        (lambda tally: tally.stops_s.clear(), "no stop was asked for"),
    ],
)
def test_what_must_not_happen_is_a_fault(change, words: str):
    tally = good()
    change(tally)
    assert faults(tally, {}) == [words]
    assert faults(good(), {"500": 2}) == ["status 500, 2 times"]


def test_hostile_requests_are_within_what_http_allows():
    """A megabyte is the service's own limit of a body: what is beyond it is refused unread."""
    for request in requests("127.0.0.1:8000"):
        head, _, body = request.partition(b"\r\n\r\n")
        assert head.startswith((b"POST /", b"GET /"))
        assert b"\r\nHost: 127.0.0.1:8000\r\n" in head
        assert len(body) <= 1_000_000
        assert len(head) < 66_000
