"""The controller's kinematics over its primary interface: read, imported, and compared before a motion.

The server of these tests writes its bytes from the public description of the interface.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from executor.calibration_import import ImportFailed, import_calibration, report
from executor.doctor import grade_kinematics, grade_serial
from executor.preflight import kinematics_refusals, kinematics_warnings, serial_refusals, told_models
from executor.robot import KinematicsInfo, read_kinematics
from executor.robot.kinematics_client import KinematicsReader
from planner.calibration import DhTable, published_table
from planner.cell import Cell, load_cell
from planner.kinematics import forward
from planner.robots import ROBOT_NAMES, robot
from tests.planner.calibration.arms import deviated_table, product_of

CHECKSUMS = (11, 22, 33, 44, 55, 0xFFFFFFFF)


def package(kind: int, body: bytes) -> bytes:
    """Size (4, itself included), type (1), body; big-endian."""
    return struct.pack(">IB", 5 + len(body), kind) + body


def robot_state(table: DhTable) -> bytes:
    """Robot state with kinematics info between other packages."""
    numbers = np.concatenate([table.theta, table.a, table.d, table.alpha])
    info = struct.pack(">6I", *CHECKSUMS) + numbers.astype(">f8").tobytes() + struct.pack(">I", 2)
    return package(16, package(0, b"\x00" * 42) + package(5, info) + package(1, b"\x00" * 251))


@contextlib.contextmanager
def controller(host: str, sent: bytes) -> Iterator[None]:
    """A controller that sends bytes to whoever connects, in two pieces."""
    with socket.create_server((host, 30001)) as server:

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    connection, _ = server.accept()
                    with connection:
                        connection.sendall(sent[:100])
                        connection.sendall(sent[100:])
                        connection.recv(1)  # until the client has enough

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield
        server.shutdown(socket.SHUT_RDWR)
    thread.join(5.0)


def told(table: DhTable) -> KinematicsInfo:
    return KinematicsInfo(table, CHECKSUMS, 2)


@pytest.fixture
def table() -> DhTable:
    return deviated_table("ur5e", np.random.default_rng(1))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "lab.toml"
    path.write_text('robot = "ur5e"\n[link]\nkind = "ur"\nhost = "127.0.61.1"\n')
    return path


@pytest.fixture
def calibrated_cell(path: Path, table: DhTable) -> Cell:
    path.write_text(path.read_text() + '[kinematics]\ncalibration = "arm-0815.yaml"\n')
    with controller("127.0.61.1", robot_state(table)):
        assert import_calibration(path).is_named
    return load_cell(path)


def test_the_table_arrives(table: DhTable) -> None:
    version = package(20, b"\x00" * 40)  # a robot message, which comes before the first state
    with controller("127.0.61.2", version + package(16, package(0, b"")) + robot_state(table)):
        info = read_kinematics("127.0.61.2")
    assert info.checksums == CHECKSUMS
    assert info.status == 2
    for name in ("theta", "a", "d", "alpha"):
        assert np.array_equal(getattr(info.table, name), getattr(table, name))


def test_what_is_no_primary_interface_is_refused() -> None:
    with controller("127.0.61.3", b"HTTP/1.1 400 Bad Request\r\n" * 8), pytest.raises(ValueError, match="no primary"):
        read_kinematics("127.0.61.3")
    with pytest.raises(OSError):
        read_kinematics("127.0.61.4")
    assert KinematicsReader("127.0.61.4").info() is None


def test_the_import_is_the_controllers_arm(path: Path, table: DhTable) -> None:
    with controller("127.0.61.1", robot_state(table)):
        imported = import_calibration(path)
    assert imported.path == path.with_name("lab-kinematics.yaml")
    assert imported.hash == table.hash
    assert not imported.is_named
    assert 'calibration = "lab-kinematics.yaml"' in report(imported, "lab")
    assert f"{imported.difference.largest_m * 1e3:.2f} mm" in report(imported, "lab")
    path.write_text(path.read_text() + '[kinematics]\ncalibration = "lab-kinematics.yaml"\n')
    arm = load_cell(path).robot
    q = np.random.default_rng(2).uniform(-6.0, 6.0, (200, 6))
    assert np.abs(forward(arm, q) - np.array([product_of(table, row) for row in q])).max() < 1e-9


def test_another_model_is_not_imported(path: Path) -> None:
    other = robot_state(published_table(robot("ur10e")))
    with controller("127.0.61.1", other), pytest.raises(ImportFailed, match="is not a ur5e"):
        import_calibration(path)
    with pytest.raises(ImportFailed, match="does not report its kinematics"):
        import_calibration(path)
    assert not path.with_name("lab-kinematics.yaml").exists()


def test_the_own_arm_may_move(calibrated_cell: Cell, table: DhTable) -> None:
    assert kinematics_refusals(calibrated_cell, told(table)) == []
    assert kinematics_warnings(calibrated_cell, told(table)) == []
    assert grade_kinematics(calibrated_cell, told(table)).grade == "ok"


@pytest.mark.parametrize("change", [1e-3, 2e-4])
def test_another_arm_is_refused_by_the_name_of_its_file(calibrated_cell: Cell, table: DhTable, change: float) -> None:
    other = DhTable(table.theta, table.a + np.array([0.0, change, 0.0, 0.0, 0.0, 0.0]), table.d, table.alpha)
    (reason,) = kinematics_refusals(calibrated_cell, told(other))
    for word in ("kinematic_calibration", "arm-0815.yaml", table.hash, other.hash, f"{change * 1e3:.1f} mm"):
        assert word in reason
    assert grade_kinematics(calibrated_cell, told(other)).grade == "bad"


@pytest.mark.parametrize("kind", ["ur", "sim"])
@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_another_model_is_refused_with_both_names(path: Path, name: str, kind: str) -> None:
    """Whatever the cell's kind, and whether or not it has a calibration."""
    path.write_text(path.read_text().replace('"ur"', f'"{kind}"'))
    cell = load_cell(path)
    other = published_table(robot(name))
    if name in ("ur5e", "ur7e"):  # published alike, and the same arm
        assert kinematics_refusals(cell, told(other)) == []
        return
    (reason,) = kinematics_refusals(cell, told(other))
    for word in ("wrong robot", name, other.hash, "ur5e"):
        assert word in reason
    assert kinematics_warnings(cell, told(other)) == []
    finding = grade_kinematics(cell, told(other))
    assert (finding.grade, finding.advice) == ("bad", "check `robot` and `host` in the cell file")


def test_a_calibrated_cell_names_the_other_model_too(calibrated_cell: Cell) -> None:
    (reason,) = kinematics_refusals(calibrated_cell, told(published_table(robot("ur10e"))))
    assert "a ur10e or ur12e " in reason
    assert "ur5e" in reason


def test_a_measured_arm_is_of_the_model_that_is_closest_to_it(path: Path) -> None:
    """UR3 and UR3e differ by 18.7 mm in d4 alone: a UR3 that is 1 mm longer there is still no UR3e."""
    table = published_table(robot("ur3"))
    longer = DhTable(table.theta, table.a, table.d + np.array([0.0, 0.0, 0.0, 1e-3, 0.0, 0.0]), table.alpha)
    cell = load_cell(path)
    assert told_models(cell, told(longer)) == ("ur3",)
    alike = ({"ur5e", "ur7e"}, {"ur10e", "ur12e"})
    for name in ROBOT_NAMES:
        measured = deviated_table(name, np.random.default_rng(3))
        assert set(told_models(cell, told(measured))) == next((names for names in alike if name in names), {name})
    unknown = DhTable(table.theta, 2.0 * table.a, table.d, table.alpha)
    assert told_models(cell, told(unknown)) == ()
    (reason,) = kinematics_refusals(load_cell(path), told(unknown))
    assert "does not know" in reason


def test_an_arm_that_does_not_tell_is_refused(path: Path, calibrated_cell: Cell) -> None:
    path.write_text('robot = "ur5e"\n[link]\nkind = "sim"\n')
    for cell in (calibrated_cell, load_cell(path)):
        assert "does not report" in kinematics_refusals(cell, None)[0]
        assert grade_kinematics(cell, None).grade == "bad"


def test_a_missing_calibration_is_a_warning_with_its_size(path: Path, table: DhTable) -> None:
    cell = load_cell(path)
    assert kinematics_refusals(cell, told(table)) == []
    (warning,) = kinematics_warnings(cell, told(table))
    assert "mm in the median" in warning
    assert "--from-robot" in warning
    assert kinematics_warnings(cell, told(published_table(robot("ur5e")))) == []
    assert grade_kinematics(cell, told(table)).grade == "warning"
    assert grade_kinematics(cell, told(published_table(robot("ur5e")))).grade == "ok"
    simulated = replace(cell, link=replace(cell.link, kind="sim"))
    assert kinematics_warnings(simulated, told(table)) == []


def test_the_robot_may_change_at_the_same_address(path: Path) -> None:
    reader = KinematicsReader("127.0.61.5")

    def told_model(info: KinematicsInfo | None) -> str:
        assert info is not None
        return told_models(load_cell(path), info)[0]

    with controller(reader.host, robot_state(published_table(robot("ur5e")))):
        assert told_model(reader.info()) == "ur5e"
    with controller(reader.host, robot_state(published_table(robot("ur3e")))):
        assert told_model(reader.info()) == "ur5e"  # remembered for a minute
        assert told_model(reader.read()) == "ur3e"
    reader.forget()
    assert reader.info() is None


@pytest.mark.parametrize(
    ("serial", "word"),
    [("20245500815", ""), ("20245500816", "its serial number is 20245500816"), (None, "does not tell")],
)
def test_a_stated_serial_number_is_compared(path: Path, serial: str | None, word: str) -> None:
    assert serial_refusals(load_cell(path), serial) == []
    assert grade_serial(load_cell(path), serial).grade == ("ok" if serial else "warning")
    path.write_text(path.read_text() + 'serial = "20245500815"\n')
    cell = load_cell(path)
    reasons = serial_refusals(cell, serial)
    assert grade_serial(cell, serial).grade == ("bad" if word else "ok")
    assert bool(reasons) == bool(word)
    for reason in reasons:
        assert word in reason
        assert "20245500815" in reason
