"""The notebook docs/gallery/in-passing.md, run as it stands there: it asserts what the tool does, and draws it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest
from matplotlib import pyplot as plt

import fling

PAGE = Path(__file__).parents[2] / "docs" / "gallery" / "in-passing.md"
CELL = re.compile(r"```\{code-cell\}\n(.*?)```", re.S)


@pytest.fixture(scope="module")
def names() -> Iterator[dict[str, Any]]:
    """What the notebook's cells leave behind."""
    before = mpl.get_backend()
    plt.switch_backend("agg")
    found: dict[str, Any] = {}
    for cell in CELL.findall(PAGE.read_text()):
        exec(cell, found)
    yield found
    plt.close("all")
    plt.switch_backend(before)


@pytest.mark.slow
def test_the_hit_is_certified_and_its_outputs_end(names: dict[str, Any]) -> None:
    plan = names["hit"]
    assert isinstance(plan, fling.Plan)
    assert plan.certificate.valid
    assert plan.flight is None
    edges = [edge for passed in plan.passages for edge in passed.edges]
    assert [edge.level for edge in edges] == [True, False]


def test_every_example_has_a_picture_with_its_outputs(names: dict[str, Any]) -> None:
    assert names["hit"].certificate.valid
    figures = [plt.figure(number) for number in plt.get_fignums()]
    spans = [len(figure.axes[1].patches) for figure in figures]
    assert spans == [1, 0]
    for figure in figures:
        path, _ = figure.axes
        (first, *others) = [line.get_xydata() for line in path.lines]
        on = others[: len(figure.axes[1].patches)]
        assert all(0 < len(piece) < len(first) for piece in on)


def test_two_objects_fly_to_two_places_in_one_motion(names: dict[str, Any]) -> None:
    both = names["both"]
    assert isinstance(both, fling.Plan)
    assert both.certificate.valid
    first, second = both.passages
    assert first.time_s < second.time_s
    assert first.command_time_s == pytest.approx(first.time_s - 0.040 - 0.020)
    assert second.command_time_s == pytest.approx(second.time_s - 0.030 - 0.020)
    for passed, place in zip(both.passages, names["PLACES"], strict=True):
        assert passed.flight is not None
        assert passed.flight.path[0] == pytest.approx(passed.position)
        assert passed.flight.path[-1] == pytest.approx(place, abs=1e-3)
    assert both._repr_html_().count('class="flight"') == 4  # two in each view
