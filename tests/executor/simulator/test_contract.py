"""The contract with the real ur_rtde client, over the versions the simulator presents; and on request elsewhere.

`pytest tests/executor/simulator/test_contract.py --controller HOST` runs the calls against URSim or a real controller
instead, but for those that stop the robot or drive it into something. The arm moves by less than 0.15 rad: give it
room first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from .conftest import Start
from .contract import CALLS, SIMULATED_ONLY, Client, move_until_contact

VERSIONS = [("ur5", "3.15"), ("ur5e", "5.11.1"), ("ur5e", "5.22")]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every call with every simulated version; with `--controller`, with that controller alone."""
    if "call" not in metafunc.fixturenames:
        return
    host = metafunc.config.getoption("--controller", default=None)
    targets = [host] if host else VERSIONS
    calls = CALLS if host else [*CALLS, *SIMULATED_ONLY]
    names = [host] if host else [version for _, version in VERSIONS]
    metafunc.parametrize("client", targets, ids=names, indirect=True, scope="module")
    metafunc.parametrize("call", calls, ids=lambda call: call.__name__)


@pytest.fixture(scope="module")
def client(request: pytest.FixtureRequest, start_simulator: Start) -> Iterator[Client]:
    """A client of a simulator, which has met no malformed package and skipped no cycle at the end."""
    if isinstance(request.param, str):
        connected = Client.connect(request.param)
        yield connected
        connected.close()
        return
    robot, version = request.param
    simulator = start_simulator(robot, ("--protective-stop-lock-s", "0.2"), polyscope=version)
    connected = Client.connect(simulator.host)
    yield connected
    connected.close()
    assert simulator.ask("stats")["malformed_packages"] == 0, simulator.ask("events")


def test_move_until_contact_ends_on_the_floor_and_comes_back_to_it(start_simulator: Start) -> None:
    connected = Client.connect(start_simulator().host)
    move_until_contact(connected)
    connected.close()


def test_a_controller_keeps_the_contract(client: Client, call: Callable[[Client], None]) -> None:
    call(client)
