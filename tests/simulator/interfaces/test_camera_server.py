"""The camera above a feeder, asked over HTTP as any client would."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from simulator.loop import SimulatorLoop
from simulator.settings import CAMERA_PORT, SimulatorSettings
from simulator.simulation import Simulation
from simulator.truth import load_truth
from tests.simulator.conftest import make_cell, unique_address

WITHIN_S = 20.0


@pytest.fixture
def camera(tmp_path: Path) -> Iterator[http.client.HTTPConnection]:
    """A connection to the camera of a feeder, whose truth is hidden."""
    cell = make_cell()
    truth = tmp_path / "truth.toml"
    truth.write_text("[feeder]\nplaces = [[0.5, 0.1, 0.02], [0.6, 0.1, 0.02]]\n[camera]\nstd_m = 0.001\n")
    host = unique_address()
    loop = SimulatorLoop(Simulation(cell, SimulatorSettings(), host, load_truth(truth, cell)))
    thread = threading.Thread(target=loop.run)
    thread.start()
    client = http.client.HTTPConnection(host, CAMERA_PORT, timeout=WITHIN_S)
    yield client
    client.close()
    loop.quit()
    thread.join()


def asked(client: http.client.HTTPConnection, method: str, path: str) -> tuple[int, dict]:
    client.request(method, path)
    answer = client.getresponse()
    return answer.status, json.loads(answer.read())


def test_it_tells_where_objects_lie_by_get_alone(camera: http.client.HTTPConnection) -> None:
    looks = [asked(camera, "GET", "/objects") for _ in range(2)]
    for status, found in looks:
        assert status == 200
        xs = sorted(each["position_m"][0] for each in found["objects"])
        assert xs == pytest.approx([0.5, 0.6], abs=0.006)
        assert {each["std_m"] for each in found["objects"]} == {0.001}
    assert looks[1][1]["t"] >= looks[0][1]["t"]
    assert looks[1][1]["objects"] != looks[0][1]["objects"]
    assert asked(camera, "POST", "/objects")[0] == 405
    assert asked(camera, "GET", "/")[0] == 404
