"""ThrowBench: the judge names the rules that spoilt answers break, sets keep their hash, entries are cut and heard."""

from __future__ import annotations

import copy
import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from audit.judge.pinocchio_arm import arm_model, poses_and_velocity
from benchmarks.peers.arm import PeerArm
from benchmarks.peers.ruckig_alone import plan
from benchmarks.throwbench import HASHES, hash_of, hidden_problems, load_set, sets, verify
from benchmarks.throwbench.__main__ import main
from benchmarks.throwbench.entries import BUILT_IN, EntryMissing, entry_of
from benchmarks.throwbench.fling_entries import service_request
from benchmarks.throwbench.problem_document import problem_from_document
from planner.request import problem_from_request
from tests.planner.problems import cell

ADDRESS = "127.0.55.1"
ENTRY = """
import os, sys, time

def answer(problem):
    print("a banner")
    return {"refused": problem["name"]}

def hang(problem):
    if problem["name"] == "slow":
        time.sleep(60.0)
    return {"refused": "in time"}

def crash(problem):
    raise ValueError("a fault of its own")

def end(problem):
    os._exit(7)
"""


@pytest.fixture(scope="module")
def problem() -> dict[str, Any]:
    """The fifteenth of the SDU table's near targets: ticks of 8 ms make it quick to judge."""
    return load_set("sdu-near-2")[14]


@pytest.fixture(scope="module")
def answer(problem) -> dict[str, Any]:
    return plan(problem)


def changed(document, **values):
    """A copy with other values, whose keys are paths: limits__tool_speed_m_s."""
    document = copy.deepcopy(document)
    for path, value in values.items():
        place, *keys = path.split("__")[::-1]
        inner = document
        for key in keys[::-1]:
            inner = inner[key]
        inner[place] = value(inner[place]) if callable(value) else value
    return document


def share(factor):
    return lambda limits: [factor * limit for limit in limits]


def shifted(joint, offset):
    return lambda rows: [[x + offset * (i == joint) for i, x in enumerate(row)] for row in rows]


def box(centre, half):
    return [{"lower_m": [x - half for x in centre], "upper_m": [x + half for x in centre]}]


def on_the_way(problem, answer):
    """A point of the flight, 0.15 s after the release."""
    arm = PeerArm(problem)
    k = round(answer["release_time_s"] * problem["sample_rate_hz"])
    p, J = arm.tool(np.array(answer["positions"][k])[None])
    return (p[0] + 0.15 * J[0] @ answer["velocities"][k] - [0.0, 0.0, 0.5 * 9.81 * 0.15**2]).tolist()


FAR_BOX = [{"lower_m": [5.0, 5.0, 5.0], "upper_m": [6.0, 6.0, 6.0]}]
# What each rule needs to be broken: other values of the problem, of the answer.
SPOILT = {
    "start": ({}, {"positions": shifted(0, 0.01)}),
    "end_at_rest": ({}, {"positions": lambda q: q[:-20], "velocities": lambda v: v[:-20]}),
    "release_time": ({}, {"release_time_s": lambda t: t + 0.003}),
    "joint_position": ({}, {"positions": shifted(4, 1.0)}),
    "joint_velocity": ({"limits__velocity_rad_s": share(0.2)}, {}),
    "joint_acceleration": ({"limits__acceleration_rad_s2": share(0.5)}, {}),
    "joint_jerk": ({"limits__jerk_rad_s3": share(0.5)}, {}),
    "joint_torque": ({"limits__torque_n_m": share(0.2)}, {}),
    "tcp_speed": ({"limits__tool_speed_m_s": 0.5}, {}),
    "floor": ({"surroundings__floor_z_m": 0.3}, {}),
    "keep_in": ({"surroundings__keep_in": FAR_BOX}, {}),
    "keep_out": ({"surroundings__keep_out": box([0.926, 0.375, 0.3], 0.2)}, {}),
    "self_collision": ({}, {"positions": shifted(2, -1.25)}),
    "landing": ({"target__position_m": lambda p: [p[0] + 0.02, *p[1:]]}, {}),
    "landing_window": ({"target__release_window_s": 0.024}, {}),
    "release_elevation": ({"target__min_elevation_rad": 1.5}, {}),
    "release_distance": ({"target__min_horizontal_distance_m": 2.0}, {}),
    "bin_mouth": ({"target__bin": {"radius_m": 0.021, "rim_height_m": 0.05}}, {}),
    "format": ({}, {"velocities": lambda v: v[:-1]}),
}


def rules(verdict):
    return {fault.rule for fault in verdict.faults}


def test_a_right_answer_is_solved(problem, answer):
    verdict = verify(problem, answer)
    assert verdict.faults == ()
    assert verdict.outcome == "solved"
    assert verdict.release_time_s == answer["release_time_s"]
    assert verdict.landing_error_m is not None and verdict.landing_error_m < 1e-4
    assert verdict.late_error_m is not None and verdict.late_error_m > 1e-3


@pytest.mark.parametrize("rule", SPOILT)
def test_a_spoilt_answer_fails_by_the_rule_that_it_breaks(problem, answer, rule):
    of_problem, of_answer = SPOILT[rule]
    verdict = verify(changed(problem, **of_problem), changed(answer, **of_answer))
    assert verdict.outcome == "invalid"
    assert rule in rules(verdict)


def test_a_flight_through_a_box_is_invalid(problem, answer):
    here = on_the_way(problem, answer)
    verdict = verify(changed(problem, surroundings__keep_out=box(here, 0.02)), answer)
    assert "flight_clearance" in rules(verdict)


def test_a_fault_has_its_value_and_limit(problem, answer):
    verdict = verify(changed(problem, limits__tool_speed_m_s=0.5), answer)
    fault = next(fault for fault in verdict.faults if fault.rule == "tcp_speed")
    assert fault.limit == 0.5 and 0.5 < fault.value < 4.0


@pytest.mark.parametrize(
    "given",
    [
        None,
        [],
        {},
        {"positions": [[0.0] * 6] * 3, "velocities": [[float("nan")] * 6] * 3, "release_time_s": 0.0},
        {"positions": [[0.0] * 5] * 3, "velocities": [[0.0] * 5] * 3, "release_time_s": 0.0},
        {"positions": [[0.0] * 6] * 3, "velocities": [[0.0] * 6] * 3, "release_time_s": "now"},
        {
            "positions": [[0.0] * 6] * 3,
            "velocities": [[0.0] * 6] * 3,
            "release_time_s": 0.0,
            "times_s": [0.0, 1.0, 0.5],
        },
    ],
)
def test_what_cannot_be_read_is_invalid_by_its_format(problem, given):
    assert rules(verify(problem, given)) == {"format"}


def test_a_refusal_is_no_fault(problem):
    verdict = verify(problem, {"refused": "too far"})
    assert (verdict.outcome, verdict.faults, verdict.reason) == ("refused", (), "too far")


def test_samples_at_other_times_are_put_on_ticks(problem, answer):
    count = len(answer["positions"])
    rate = problem["sample_rate_hz"]
    times = [i / rate for i in range(count)]
    assert verify(problem, answer | {"times_s": times}).outcome == "solved"
    stretched = verify(problem, answer | {"times_s": [0.9 * t for t in times]})
    assert rules(stretched) & {"joint_jerk", "landing"}


def test_the_document_is_enough_for_kinematics_and_torques():
    """The peers' arm, from the document's numbers, agrees with Pinocchio's from the published files."""
    problems = [load_set("random-2")[1], *hidden_problems(1, 3)]
    q, qd, qdd = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 4, 6))
    for problem in problems:
        arm = PeerArm(problem)
        here = problem_from_document(problem).cell
        p, J = arm.tool(q)
        for held in (True, False):
            model = arm_model(here, held)
            data = model.createData()
            for i in range(4):
                poses, v = poses_and_velocity(here, model, data, q[i], qd[i])
                np.testing.assert_allclose(p[i], poses[6].act(here.tool.X_FT[:3, 3]), atol=1e-7)
                np.testing.assert_allclose(J[i] @ qd[i], v, atol=1e-7)
            tau = [pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)]
            np.testing.assert_allclose(arm.torques(q, qd, qdd, held), tau, atol=1e-6)


@pytest.mark.parametrize("name", HASHES)
def test_every_set_is_that_of_its_hash(name):
    problems = load_set(name)
    assert len({problem["name"] for problem in problems}) == len(problems) >= 16


def test_a_changed_set_is_refused(tmp_path, monkeypatch):
    text = (sets.FOLDER / "random-2.json").read_text()
    (tmp_path / "random-2.json").write_text(text.replace("0.01", "0.02", 1))
    monkeypatch.setattr(sets, "FOLDER", tmp_path)
    with pytest.raises(sets.SetChanged, match="random-2: the problems' sha256 is"):
        load_set("random-2")


def test_exported_files_carry_their_hash(tmp_path, capsys):
    assert main(["--export", str(tmp_path), "--seed", "3", "--count", "1"]) == 0
    files = [Path(line) for line in capsys.readouterr().out.split()]
    assert len(files) == len(HASHES) + 1
    for file in files:
        document = json.loads(file.read_text())
        assert document["sha256"] == hash_of(document["problems"])
        assert document["name"].startswith("hidden") or document["sha256"] == HASHES[document["name"]]


def test_hidden_cells_depend_on_the_seed_alone():
    (first,), (same, _), (other,) = (hidden_problems(count, seed) for count, seed in ((1, 3), (2, 3), (1, 4)))
    assert first == same
    assert {key for key in first if first[key] != other[key]} >= {"base", "tool", "limits", "target"}


def test_a_peer_imports_nothing_else_of_fling(tmp_path, problem):
    """It plans in a process in which nothing else of the project was loaded."""
    code = (
        "import json, sys; from benchmarks.peers.ruckig_alone import plan\n"
        "print(len(plan(json.load(sys.stdin))['positions']))\n"
        "own = {name.partition('.')[0] for name in sys.modules} & {'planner', 'fling', 'tests', 'batch', 'learning'}\n"
        "own |= {name for name in sys.modules if name.startswith('benchmarks.')}\n"
        "print(sorted(own - {f'benchmarks.peers{x}' for x in ('', '.arm', '.motions', '.releases', '.ruckig_alone')}))"
    )
    done = subprocess.run([sys.executable, "-c", code], input=json.dumps(problem), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    count, rest = done.stdout.split("\n")[:2]
    assert int(count) > 10
    assert rest == "[]"


def test_the_code_of_the_page_works(root, problem, tmp_path, monkeypatch, capsys):
    """Its kinematics agree with Pinocchio's; its smallest entry refuses, and is judged."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "problems").mkdir()
    (tmp_path / "problems" / "random-2.json").write_text(json.dumps({"problems": [problem]}))
    page = (root / "docs" / "throwbench.md").read_text()
    code: dict[str, Any] = {}
    exec("\n".join(re.findall(r"```python\n(.*?)```", page, flags=re.S)), code)
    q = np.array([0.3, -1.0, 1.2, -0.4, 0.8, 2.0])
    here = problem_from_document(problem).cell
    model = arm_model(here, True)
    poses, _ = poses_and_velocity(here, model, model.createData(), q, q)
    np.testing.assert_allclose(code["tool"](problem, q), poses[6].act(here.tool.X_FT[:3, 3]), atol=1e-7)
    assert capsys.readouterr().out.startswith("refused\nthe target is")


@pytest.mark.parametrize("rule", [*SPOILT, "flight_clearance"])
def test_every_rule_is_on_the_page(root, rule):
    assert f"`{rule}`" in (root / "docs" / "throwbench.md").read_text()


@pytest.fixture(scope="module")
def module(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("entry") / "mine.py"
    file.write_text(ENTRY)
    return file


def test_a_function_answers_whatever_it_prints(module):
    entry = entry_of(f"mine={module}:answer")
    reply = entry.ask({"name": "first"}, 30.0)
    entry.close()
    assert (entry.name, reply.outcome, reply.answer) == ("mine", "answered", {"refused": "first"})
    assert reply.processor_s is not None and reply.wall_s > 0.0


def test_a_function_that_hangs_is_cut_and_asked_again(module):
    entry = entry_of(f"{module}:hang")
    begun = time.perf_counter()
    assert entry.ask({"name": "slow"}, 0.3).outcome == "timed out"
    assert time.perf_counter() - begun < 30.0
    assert entry.ask({"name": "quick"}, 30.0).answer == {"refused": "in time"}
    entry.close()


@pytest.mark.parametrize(("function", "reason"), [("crash", "a fault of its own"), ("end", "ended with 7")])
def test_a_function_that_crashes_is_reported(module, function, reason):
    entry = entry_of(f"{module}:{function}")
    reply = entry.ask({"name": "any"}, 30.0)
    entry.close()
    assert reply.outcome == "crashed"
    assert reason in reply.reason


def test_an_entry_that_cannot_be_loaded_is_named(module):
    with pytest.raises(EntryMissing, match="no_such"):
        entry_of(f"{module}:no_such").ask({"name": "any"}, 1.0)
    with pytest.raises(EntryMissing, match="none of fling"):
        entry_of("flung")


def test_an_entry_whose_package_is_missing_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setitem(BUILT_IN, "drake", (BUILT_IN["drake"][0], "no_such_package"))
    page = tmp_path / "page.md"
    arguments = ["--entries", "drake", "--sets", "random-2", "--count", "1", "--out", str(page)]
    assert main([*arguments, "--rows", str(tmp_path / "rows.jsonl")]) == 0
    assert "Left out: `drake` (no_such_package is not installed)." in page.read_text()


def test_a_named_entry_that_cannot_be_loaded_ends_the_run(tmp_path, capsys):
    for entry in ("nowhere.py:plan", f"mine=http://{ADDRESS}:9/plan"):
        page = tmp_path / "page.md"
        assert main(["--entries", entry, "--sets", "random-2", "--count", "1", "--out", str(page)]) == 2
        assert entry.split("=")[-1] in capsys.readouterr().err and not page.exists()


def test_crashes_are_asked_again_and_the_rest_is_kept(tmp_path, module, capsys):
    page = tmp_path / "page.md"
    arguments = ["--entries", f"mine={module}:answer", "--sets", "random-2", "--count", "2", "--out", str(page)]
    assert main(arguments) == 0
    rows = [json.loads(line) for line in (tmp_path / "page.jsonl").read_text().splitlines()]
    rows[0]["verdict"]["outcome"] = "crashed"
    (tmp_path / "page.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    capsys.readouterr()
    assert main([*arguments, "--resume"]) == 0
    asked = capsys.readouterr().err
    assert rows[0]["problem"] in asked and rows[1]["problem"] not in asked
    assert json.loads(page.with_suffix(".json").read_text())["rows"][-1]["verdict"]["outcome"] == "refused"


def test_a_page_without_its_ending_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["--out", "table.json"])
    assert "does not end in .md" in capsys.readouterr().err


class Handler(BaseHTTPRequestHandler):
    def do_POST(self):
        problem = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        if problem["name"] == "slow":
            time.sleep(1.0)
        body = json.dumps({"refused": problem["name"], "processor_time_s": 0.25}).encode()
        self.send_response(500 if problem["name"] == "broken" else 200)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


class Server(ThreadingHTTPServer):
    daemon_threads = False  # none outlives its test

    def handle_error(self, *_):
        """Says nothing of a client that did not wait: the words would be another test's output."""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    server = Server((ADDRESS, 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://{ADDRESS}:{server.server_port}/plan"
    server.shutdown()
    server.server_close()
    thread.join()


def test_an_http_entry_answers_times_out_and_fails(address):
    entry = entry_of(f"theirs={address}")
    reply = entry.ask({"name": "any"}, 30.0)
    assert (reply.outcome, reply.answer["refused"], reply.processor_s) == ("answered", "any", 0.25)
    assert entry.ask({"name": "slow"}, 0.2).outcome == "timed out"
    broken = entry.ask({"name": "broken"}, 30.0)
    assert (broken.outcome, broken.reason) == ("crashed", "status 500")
    entry.close()


def test_flings_service_gets_the_same_problem():
    problem = load_set("bins-2")[0]
    request = service_request(problem)
    asked = problem_from_document(problem)
    posted = problem_from_request(request, cell("ur5e-sim"))
    np.testing.assert_array_equal(posted.start, asked.start)
    assert posted.release.opening == asked.release.opening
    assert posted.release_window_s == 0.0
    with pytest.raises(ValueError, match="keep-out boxes"):
        service_request(load_set("walls-2")[0])


def test_one_command_writes_page_and_json(tmp_path, module):
    page = tmp_path / "page.md"
    arguments = ["--entries", f"mine={module}:answer", "--sets", "random-2", "--count", "2", "--out", str(page)]
    assert main([*arguments, "--rows", str(tmp_path / "rows.jsonl")]) == 0
    assert "| mine | 0 % | 0 % | 100 % | 0 % |" in page.read_text()
    document = json.loads(page.with_suffix(".json").read_text())
    assert [row["verdict"]["outcome"] for row in document["rows"]] == ["refused", "refused"]
