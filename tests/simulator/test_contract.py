"""The contract with the real ur_rtde client, for every version the simulator presents.

`pytest tests/simulator/test_contract.py --controller HOST` makes the calls to URSim or a real controller
instead, except those that stop the robot. The arm moves by less than 0.15 rad: give it room first. The simulated
versions are called in parallel, as the calls mostly wait for an arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.simulator.conftest import Start
from tests.simulator.contract import CALLS, SIMULATED_ONLY, ContractClient, move_until_contact

VERSIONS = {"3.15": "ur5", "5.11.1": "ur5e", "5.23.0": "ur5e", "10.14.0": "ur7e"}
Call = Callable[[ContractClient], None]
Verdicts = dict[tuple[str, Call], Exception | None]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every call with every simulated version; with `--controller`, with that controller alone."""
    if "call" not in metafunc.fixturenames:
        return
    host = metafunc.config.getoption("--controller", default=None)
    metafunc.parametrize("target", [host] if host else VERSIONS)
    metafunc.parametrize("call", CALLS if host else [*CALLS, *SIMULATED_ONLY], ids=lambda call: call.__name__)


@pytest.fixture(scope="module")
def verdicts(request: pytest.FixtureRequest, start_simulator: Start) -> Verdicts:
    """Outcome of every selected call. No simulator may have received a malformed package."""
    selected: dict[str, list[Call]] = {}
    for item in request.session.items:
        params = item.callspec.params if isinstance(item, pytest.Function) and hasattr(item, "callspec") else {}
        if "call" in params:
            selected.setdefault(params["target"], []).append(params["call"])

    def verify(target: str) -> Verdicts:
        if target not in VERSIONS:
            return called(target, target, selected[target])
        options = ("--protective-stop-lock-s", "1.0")
        simulator = start_simulator(VERSIONS[target], options, polyscope=target)
        found = called(target, simulator.host, selected[target])
        assert simulator.ask("stats")["malformed_packages"] == 0, simulator.ask("events")
        return found

    with ThreadPoolExecutor(len(selected)) as pool:
        return {key: verdict for found in pool.map(verify, selected) for key, verdict in found.items()}


def called(target: str, host: str, calls: Sequence[Call]) -> Verdicts:
    """Makes calls, one after the other; returns what each raised."""
    client = ContractClient.connect(host)
    found: Verdicts = {}
    for call in calls:
        try:
            call(client)
            found[target, call] = None
        except (AssertionError, RuntimeError, ValueError) as error:
            found[target, call] = error
    client.close()
    return found


def test_a_controller_keeps_the_contract(verdicts: Verdicts, target: str, call: Call) -> None:
    verdict = verdicts[target, call]
    if verdict is not None:
        raise verdict


@pytest.mark.slow
def test_move_until_contact_ends_on_the_floor_and_comes_back_to_it(start_simulator: Start) -> None:
    connected = ContractClient.connect(start_simulator().host)
    move_until_contact(connected)
    connected.close()
