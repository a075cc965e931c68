"""Rigs for system tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.rig import Rig

# A virtual machine stalls for 10 to 30 ms now and then, even for C programs at real-time priority (measured with
# clock_nanosleep). The simulated controller's clock slips with the stream's processor, so a throw survives that; a test
# that kills or freezes within a few ticks may still miss its moment. Only tests of this folder are repeated.
STALL_RETRIES = 2


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Repeats failed tests of whole processes."""
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.flaky(reruns=STALL_RETRIES))


@pytest.fixture(scope="session")
def shared_rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """One simulated controller with its executor for all tests, one after the other."""
    rig = Rig(tmp_path_factory.mktemp("rig"))
    rig.start()
    yield rig
    rig.stop()


@pytest.fixture
def rig(shared_rig: Rig) -> Rig:
    """The shared rig, brought back in order."""
    shared_rig.stand_up()
    return shared_rig


@pytest.fixture
def own_rig(tmp_path: Path) -> Iterator[Rig]:
    """A rig of this test only, not started."""
    rig = Rig(tmp_path)
    yield rig
    rig.stop()
