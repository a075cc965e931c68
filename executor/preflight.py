"""Checks before an execution: the plan's certificate, and the live robot's readiness to move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from executor.robot import OWNER_INPUT, ControlMode, KinematicsInfo, RobotSession, RobotState
from executor.streaming.state_checks import OUTPUT_SHIFT, ROBOT_RUNNING, safety_words
from learning import cell_with_profile
from planner.answer import aim_shift, flight_of_own_gripper, plan_from_document
from planner.calibration import DhTable, ImplausibleChain, calibrated, transforms_of_table
from planner.cell import Cell
from planner.certificate import Examination
from planner.errors import PlannerError
from planner.grippers import KINDS
from planner.kinematics import ChainDifference, chain_difference
from planner.passages import OutputSwitch, output_edges
from planner.problem import ThrowProblem
from planner.robots import ROBOT_NAMES, Robot, robot
from planner.rotations import matrix_to_rotation_vector, rotation_vector_to_matrix
from planner.trajectory import Trajectory
from store import PlanRow, ProfileRow
from verifier import NotAPlan, verify

Vector = NDArray[np.float64]

ROBOT_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "confirming safety",
    2: "booting",
    3: "powered off",
    4: "powered on",
    5: "idle: brakes not released",
    6: "in backdrive",
    8: "updating its firmware",
}
POLYSCOPE_X = 10  # major version; ur_rtde connects to a dashboard below it
MENDED_BY = {3: "power-on", 5: "brake-release"}  # robot_mode -> command of `fling robot` that ends it
REST_RAD_S = 0.01  # [rad/s] an arm this slow counts as at rest; above the noise of a measured joint speed
PAYLOAD_KG = 0.05  # [kg] accepted difference of the controller's payload from the tool, or tool and object
TCP_M = 1e-3
TCP_RAD = 5e-3  # [m, rad] accepted difference of its tool centre point: a millimetre at the object
KINEMATICS_M = 1e-4  # [m] accepted difference of the controller's arm from the cell's, at its worst posture
SAME_CHAIN_M = 1e-9  # [m] rounding: two models this much alike are one to their controllers, as UR5e and UR7e
TABLES_KEPT = 8  # arms whose model is remembered: a heartbeat asks four times a second
SPEED = 1e-3  # [-] accepted difference of the speed slider from 1: rounding only
NO_HASH = "the plan was stored by an earlier version of Fling, without a hash of its content: plan again"


class ExecutionRefused(Exception):
    """The execution does not start; the text says why."""


@dataclass(frozen=True)
class PreflightReport:
    """What a robot and its controller tell before a motion.

    Attributes:
        refusals: every reason not to move it; empty where it may move.
        warnings: what a person should know; it may move all the same.
        serial: serial number of the robot; None where its controller does not tell it.
    """

    refusals: list[str]
    warnings: list[str] = field(default_factory=list)
    serial: str | None = None


def verify_content(plan: PlanRow) -> None:
    """Checks that a stored plan is what its planner wrote, under this id.

    Raises:
        ExecutionRefused: it is not, or nobody can tell.
    """
    if plan.sha256 is None:
        raise ExecutionRefused(NO_HASH)
    if not plan.is_intact:
        raise ExecutionRefused("the stored plan is not what its planner wrote (its hash differs): plan again")


def verify_plan(
    document: bytes, cell: Cell, profile: ProfileRow | None = None
) -> tuple[ThrowProblem, Trajectory, Vector]:
    """Certifies a stored plan again, with this executor's own cell and the profile that the cell uses.

    Returns:
        Problem, trajectory, and by how much the aim lies off the target (3,) [m].

    Raises:
        ExecutionRefused: the plan is for another cell file or profile, cannot be read, or fails its certificate.
    """
    try:
        plan = orjson.loads(document)
        if plan["cell"] != cell.name or plan["cell_sha256"] != cell.sha256:
            raise ExecutionRefused(f"the plan was made for another version of the cell {plan['cell']!r}: plan again")
        used = None if profile is None else profile.id
        if plan.get("profile") != used:
            raise ExecutionRefused(f"the plan was made with profile {plan.get('profile')}, not {used}: plan again")
        learnt = None if profile is None else orjson.loads(profile.document)
        own = cell_with_profile(cell, learnt)
        problem, trajectory = plan_from_document(plan, own)
        if made_for := _other_flight(plan, own):
            raise ExecutionRefused(made_for)
        shift = aim_shift(plan)
    except KeyError as error:
        raise ExecutionRefused(f"the plan cannot be read: it has no {error}") from error
    except (PlannerError, TypeError, orjson.JSONDecodeError) as error:
        raise ExecutionRefused(f"the plan cannot be read: {error}") from error
    if failures := Examination(problem, trajectory).failures:
        names = ", ".join(f"{c.name} ({c.value:.4g} against {c.limit:.4g} {c.unit})" for c in failures)
        raise ExecutionRefused(f"the plan fails the certificate that the executor made: {names}")
    return problem, trajectory, shift


def prove_plan(document: bytes, cell: Cell, profile: ProfileRow | None = None) -> None:
    """Proves a plan that was certified, by the verifier, which shares nothing with the certificate.

    Raises:
        ExecutionRefused: it is not proven; with the checks, and where.
    """
    try:
        learnt = None if profile is None else {**orjson.loads(profile.document), "id": profile.id}
        verdict = verify(orjson.loads(document), cell, learnt)
    except NotAPlan as error:
        raise ExecutionRefused(f"the plan cannot be verified: {error}") from error
    if verdict.open:
        why = "; ".join(verdict.reasons)
        raise ExecutionRefused(f"FLING_VERIFY is on, and the plan is {verdict.status}: {why}")


def _other_flight(plan: Mapping[str, Any], own: Cell) -> str | None:
    """Returns how a plan's flight was made for another object than this cell's; None where it agrees, or is silent."""
    flight = flight_of_own_gripper(plan)
    here = {
        "release_speed_factor": own.gripper.release_speed_factor,
        "drag_coefficient": own.object.drag_coefficient,
    }
    for name, value in here.items():
        if flight.get(name, value) != value:
            return f"the plan's flight was made with flight.{name} = {flight[name]}, not {value}: plan again"
    return None


def gripper_is_open(cell: Cell, state: RobotState) -> bool:
    """Returns whether the gripper's output is at the level that opens it; False where no output switches it."""
    gripper = cell.gripper
    return gripper.link is None and output_is(state, gripper.output, gripper.index, gripper.open_level)


def output_is(state: RobotState, output: str, index: int, level: bool) -> bool:
    """Returns whether a digital output is at a level."""
    return bool(state.outputs >> OUTPUT_SHIFT[output] + index & 1) == level


def open_grippers(cell: Cell, state: RobotState) -> list[str]:
    """Returns the further grippers of a tool whose outputs are at the level that opens them, in words.

    A run closes the cell's own gripper alone: the motion is certified with what the others hold.
    """
    found = []
    for name, each in cell.grippers.items():
        gripper = each.gripper
        if name and output_is(state, gripper.output, gripper.index, gripper.open_level):
            line = f"{gripper.output} {gripper.index} is {'on' if gripper.open_level else 'off'}"
            found.append(f"the gripper {name!r} is open: {line}; load and close it")
    return found


def gripper_document(cell: Cell, state: RobotState | None) -> dict[str, bool | None]:
    """Returns what outputs and inputs show of the gripper, as `GET /cells/{name}/state` does; null: nothing."""
    number = cell.gripper.grip_input
    return {
        "gripper_open": None if state is None or cell.gripper.link is not None else gripper_is_open(cell, state),
        "gripper_holds": None if state is None or number is None else bool(state.inputs >> number & 1),
    }


def output_level_warnings(problem: ThrowProblem, trajectory: Trajectory, state: RobotState) -> list[str]:
    """Returns the outputs of a plan's passages that have the level of their first edge already."""
    first: dict[tuple[str, int], OutputSwitch] = {}
    for edge in output_edges(problem.cell, problem.passages, trajectory):
        first.setdefault((edge.switch.output, edge.switch.index), edge.switch)
    return [
        f"{each.output} {each.index} is {'on' if each.level else 'off'} already: its first edge will not be seen"
        for each in first.values()
        if output_is(state, each.output, each.index, each.level)
    ]


def readiness(session: RobotSession) -> PreflightReport:
    """Returns whether the session's robot may move now, and which robot it is."""
    cell = session.cell
    state = session.monitor.fresh()
    if state is None:
        session.kinematics_reader.forget()  # another robot may answer next
        return PreflightReport(refusals(cell, None, None))
    if session.monitor.owned is False:
        return PreflightReport([taken_words(session.monitor.host)])
    version = session.monitor.version
    mode = session.console.control_mode()
    serial = session.console.serial_number()
    info = session.kinematics()
    found = [*refusals(cell, state, mode, version), *serial_refusals(cell, serial), *kinematics_refusals(cell, info)]
    warnings = [*control_warnings(mode, version), *kinematics_warnings(cell, info), *gripper_warnings(cell)]
    return PreflightReport(found, warnings, serial)


def taken_words(host: str) -> str:
    """Returns why a controller is not moved that another client owns."""
    return f"another executor is connected to the controller at {host}: it holds {OWNER_INPUT}"


def refusals(
    cell: Cell, state: RobotState | None, mode: ControlMode | None, version: tuple[int, ...] | None = None
) -> list[str]:
    """Returns every reason not to move a robot that its state and control mode give; empty where it may move.

    Args:
        cell: as the executor reads it.
        state: the robot's live state; None without a connection.
        mode: who controls the robot; None where neither dashboard nor Robot API answers.
        version: of the controller's software; None where it is not known.
    """
    if state is None:
        return [f"no state arrives from the controller at {cell.link.host}"]
    return [*_control(cell, mode, version), *state_refusals(cell, state)]


def state_refusals(cell: Cell, state: RobotState) -> list[str]:
    """Returns every reason not to move a robot that its state gives; empty where it may move."""
    return [*_condition(state), *_tool(cell, state)]


def serial_refusals(cell: Cell, serial: str | None) -> list[str]:
    """Returns why a robot is not the one whose serial number the cell file states; empty where it states none.

    Args:
        cell: as the executor reads it.
        serial: what the controller tells; None where it tells none.
    """
    stated = cell.link.serial
    if stated is None or serial == stated:
        return []
    told = "its controller does not tell its serial number" if serial is None else f"its serial number is {serial}"
    return [f"wrong robot: {told}, the cell file states {stated} (link.serial)"]


def kinematics_refusals(cell: Cell, info: KinematicsInfo | None) -> list[str]:
    """Returns why a robot's arm is not the cell's; empty where it is.

    Without a calibration any arm of the cell's model may move, as all of them are published alike.

    Args:
        cell: as the executor reads it.
        info: what the controller tells of its arm; None without an answer.
    """
    name = cell.robot.name
    if info is None:
        return [
            f"kinematics: the controller at {cell.link.host} does not report its arm, which may be no {name} at all "
            "(primary interface, port 30001)"
        ]
    models = told_models(cell, info)
    if name not in models:
        told = f"a {' or '.join(models)}" if models else "an arm of another model, which Fling does not know"
        return [f"wrong robot: the controller moves {told} ({info.table.hash}), the cell's arm is a {name}"]
    if cell.calibration is None:
        return []
    apart = difference_from(cell, info)
    if apart is None or apart.largest_m > KINEMATICS_M:
        size = "" if apart is None else f"up to {apart.largest_m * 1e3:.1f} mm away; "
        return [
            f"kinematic_calibration: {cell.calibration.name} ({cell.calibration.hash or 'no hash'}) is another arm's: "
            f"the controller's ({info.table.hash}) is {size}`fling cell kinematics --from-robot` reads this arm's"
        ]
    return []


def kinematics_warnings(cell: Cell, info: KinematicsInfo | None) -> list[str]:
    """Returns the warning that a real arm has no calibration, with the size of the error that this hides."""
    if cell.calibration is not None or cell.link.kind == "sim" or info is None:
        return []
    apart = difference_from(cell, info)
    if apart is None or apart.largest_m <= KINEMATICS_M:
        return []
    advice = "`fling cell kinematics --from-robot` reads it"
    return [f"kinematic_calibration: none in the cell file; this arm is off by {apart.words()}; {advice}"]


def gripper_warnings(cell: Cell) -> list[str]:
    """Returns the warning that somebody's own code opens the gripper, with what that does to the timing."""
    call = KINDS[cell.gripper.kind].call
    return [f"gripper: {call}"] if call else []


def told_models(cell: Cell, info: KinematicsInfo) -> tuple[str, ...]:
    """Returns the models of which a controller's arm can be: the closest one, and those with the same kinematics.

    Args:
        cell: whose own arm counts too, also where it is completed by the cell file.
        info: what the controller tells of its arm.
    """
    return closest_models(info.table, cell.robot.published)


@lru_cache(maxsize=TABLES_KEPT)
def closest_models(table: DhTable, *completed: Robot) -> tuple[str, ...]:
    """Returns the models whose kinematics are closest to a table: of the published arms, and of completed ones."""
    transforms = transforms_of_table(table)
    apart_m = {}
    for model in {**{name: robot(name) for name in ROBOT_NAMES}, **{arm.name: arm for arm in completed}}.values():
        with suppress(ImplausibleChain):
            apart_m[model.name] = chain_difference(calibrated(model, transforms), model).largest_m
    nearest_m = min(apart_m.values(), default=0.0)
    return tuple(name for name, m in apart_m.items() if m <= nearest_m + SAME_CHAIN_M)


def difference_from(cell: Cell, info: KinematicsInfo) -> ChainDifference | None:
    """Returns how far the cell's arm is from what its controller tells; None where that is no arm of this model."""
    try:
        told = calibrated(cell.robot.published, transforms_of_table(info.table))
    except ImplausibleChain:
        return None
    return chain_difference(told, cell.robot)


def control_warnings(mode: ControlMode | None, version: tuple[int, ...] | None) -> list[str]:
    """Returns the warning that nobody can tell whether a PolyScope X is in remote control; what it refuses, it says."""
    if not _is_polyscope_x(version) or mode in ("remote", "local"):
        return []
    missing = "the Robot API does not answer" if mode is None else "its Robot API tells it from PolyScope 10.12 on"
    return [f"whether the robot is in remote control is not known ({missing}): see its pendant"]


def _control(cell: Cell, mode: ControlMode | None, version: tuple[int, ...] | None) -> Iterator[str]:
    if mode == "local":
        where = "in the safety overview, in automatic mode" if _is_polyscope_x(version) else "at the top right"
        yield f"the robot is not in remote control: switch it on the pendant, {where}"
    elif _is_polyscope_x(version) or mode == "remote":
        return
    elif mode is None:
        services = "enable it on the pendant under Settings, Security, Services"
        yield f"the dashboard at {cell.link.host} does not answer, and ur_rtde needs it on this PolyScope: {services}"
    elif cell.robot.generation != "CB3":
        yield "the dashboard does not tell whether the robot is in remote control"


def _is_polyscope_x(version: tuple[int, ...] | None) -> bool:
    return version is not None and version[0] >= POLYSCOPE_X


def _condition(state: RobotState) -> Iterator[str]:
    if state.robot_mode != ROBOT_RUNNING:
        command = MENDED_BY.get(state.robot_mode)
        words = ROBOT_MODES.get(state.robot_mode, f"in mode {state.robot_mode}")
        yield f"the robot is {words}{f' (fling robot {command})' if command else ''}"
    if words := safety_words(state.safety_bits):
        yield f"safety: {words}"
    if abs(state.speed - 1.0) > SPEED:
        yield f"the speed slider is at {state.speed:.0%}: a throw needs 100 %"
    if (speed := max(map(abs, state.qd))) > REST_RAD_S:
        yield f"the arm is moving at {speed:.3f} rad/s"


def _tool(cell: Cell, state: RobotState) -> Iterator[str]:
    lightest = cell.tool.mass_kg
    heaviest = cell.tool.mass_kg + cell.object.mass_kg + sum(each.mass_kg for each in cell.carried)
    if state.payload_kg is not None and not lightest - PAYLOAD_KG <= state.payload_kg <= heaviest + PAYLOAD_KG:
        yield (
            f"the controller is set to a payload of {state.payload_kg:.2f} kg; "
            f"the cell file gives {lightest:.2f} to {heaviest:.2f} kg"
        )
    if state.tcp_offset is None:
        return
    offset = np.array(state.tcp_offset)
    apart = float(np.linalg.norm(offset[:3] - cell.tool.X_FT[:3, 3]))
    turn = rotation_vector_to_matrix(offset[3:]).T @ cell.tool.X_FT[:3, :3]
    turned = float(np.linalg.norm(matrix_to_rotation_vector(turn)))
    if apart > TCP_M or turned > TCP_RAD:
        yield f"the controller's tool centre point is {apart * 1e3:.1f} mm and {turned:.3f} rad off the cell's"
