"""The contract of every controller with the unmodified ur_rtde client: simulated, URSim or real.

Each function makes one call, or a few related ones, and checks the outcome. They move the arm by less than 0.15 rad
from where it stands, never faster than 1 rad/s, and leave it at rest with the control program running. Those in
SIMULATED_ONLY stop the robot on purpose.
"""

from __future__ import annotations

import math
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import dashboard_client
import numpy as np
import pytest
import rtde_control
import rtde_io
import rtde_receive

MOVE_TOLERANCE_RAD = 2e-3  # [rad] a real arm settles within encoder noise and gear play
POSE_TOLERANCE_M = 2e-3
SPEED = 0.3  # [rad/s]
PRIMARY_PORT = 30001
WITHIN_S = 3.0  # [s] far longer than a cycle or a lag, for loaded machines


class PlainCommands:
    """What takes the dashboard's place on PolyScope X here: the lines that every client interface obeys."""

    def __init__(self, host: str) -> None:
        self.host = host

    def polyscopeVersion(self) -> str:
        with socket.create_connection((self.host, PRIMARY_PORT)) as connection, connection.makefile("rb") as stream:
            body = stream.read(struct.unpack(">i", stream.read(4))[0] - 4)
        (length,) = body[11:12]  # type, time, source and kind before it; then the project's name
        return ".".join(map(str, body[12 + length : 14 + length]))

    def stop(self) -> None:
        self._send(b"stop program\n")

    def pause(self) -> None:
        self._send(b"pause program\n")

    def play(self) -> None:
        self._send(b"resume program\n")

    def unlockProtectiveStop(self) -> None:
        self._send(b"set unlock protective stop\n")

    def disconnect(self) -> None:
        return

    def _send(self, line: bytes) -> None:
        with socket.create_connection((self.host, PRIMARY_PORT)) as connection:
            connection.sendall(line)
            connection.recv(1 << 16)
            connection.recv(1 << 16)  # a state later it has been obeyed


@dataclass
class ContractClient:
    """The four interfaces of ur_rtde on one controller."""

    host: str
    control: rtde_control.RTDEControlInterface
    receive: rtde_receive.RTDEReceiveInterface
    io: rtde_io.RTDEIOInterface
    dashboard: dashboard_client.DashboardClient | PlainCommands

    @classmethod
    def connect(cls, host: str) -> ContractClient:
        dashboard: dashboard_client.DashboardClient | PlainCommands = dashboard_client.DashboardClient(host)
        try:
            dashboard.connect()
        except RuntimeError:
            dashboard = PlainCommands(host)
        return cls(
            host,
            rtde_control.RTDEControlInterface(host),
            rtde_receive.RTDEReceiveInterface(host),
            rtde_io.RTDEIOInterface(host),
            dashboard,
        )

    def close(self) -> None:
        self.control.stopScript()
        for interface in (self.control, self.receive, self.io, self.dashboard):
            interface.disconnect()

    @property
    def version(self) -> tuple[int, ...]:
        return tuple(int(x) for x in self.dashboard.polyscopeVersion().split(".")[:2])

    @property
    def step(self) -> float:
        return 0.008 if self.version[0] == 3 else 0.002

    def wait(self, condition: Callable[[], object]) -> bool:
        """Waits until `condition` holds; returns whether it did in time."""
        until = time.monotonic() + WITHIN_S
        while not condition():
            if time.monotonic() > until:
                return False
            time.sleep(0.002)
        return True

    def at_rest(self) -> bool:
        return self.wait(lambda: max(map(abs, self.receive.getTargetQd())) == 0.0)

    def near(self, q: Sequence[float]) -> bool:
        return self.wait(lambda: np.abs(np.subtract(self.receive.getActualQ(), q)).max() < MOVE_TOLERANCE_RAD)

    def aside(self, by: float = 0.05) -> list[float]:
        """Returns joint angles a little off the present ones, away from zero wrist angles."""
        q = self.receive.getTargetQ()
        return [x + by * s for x, s in zip(q, (1, -1, 1, 1, 1, -1), strict=True)]

    def ready_again(self) -> None:
        """Uploads the program again, once the last one has ended, and waits for it.

        `reuploadScript()` itself ends a program that its own copy of the state still shows, by a handshake with a time
        limit of minutes. So it is called only after the state has settled.
        """
        if self.control.isProgramRunning():
            self.dashboard.stop()
            assert self.wait(lambda: not self.control.isProgramRunning())
        self.control.reuploadScript()
        assert self.wait(self.control.isProgramRunning)
        assert self.wait(lambda: self.receive.getRuntimeState() == 2)


def receives_every_variable(c: ContractClient) -> None:
    six = "TargetQ TargetQd TargetQdd TargetCurrent TargetMoment ActualQ ActualQd ActualCurrent JointControlOutput "
    six += "ActualTCPPose ActualTCPSpeed ActualTCPForce TargetTCPPose TargetTCPSpeed JointTemperatures JointMode "
    for name in (six + "ActualJointVoltage").split():
        assert len(getattr(c.receive, f"get{name}")()) == 6, name
    assert len(c.receive.getActualToolAccelerometer()) == 3
    one = "Timestamp ActualDigitalInputBits ActualExecutionTime RobotMode SafetyMode SpeedScaling TargetSpeedFraction "
    one += "ActualMomentum ActualMainVoltage ActualRobotVoltage ActualRobotCurrent ActualDigitalOutputBits "
    one += "RuntimeState StandardAnalogInput0 StandardAnalogInput1 StandardAnalogOutput0 StandardAnalogOutput1 "
    for name in (one + "RobotStatus SafetyStatusBits SpeedScalingCombined").split():
        assert math.isfinite(getattr(c.receive, f"get{name}")()), name


def time_advances_cycle_by_cycle(c: ContractClient) -> None:
    first = c.receive.getTimestamp()
    assert c.wait(lambda: c.receive.getTimestamp() >= first + 10 * c.step)
    steps = (c.receive.getTimestamp() - first) / c.step
    assert abs(steps - round(steps)) < 1e-3


def is_in_normal_operation(c: ContractClient) -> None:
    assert c.control.isProgramRunning() and c.control.isConnected()
    assert c.receive.getRobotMode() == 7
    assert c.receive.getSafetyMode() == 1
    assert c.receive.getSafetyStatusBits() & 1
    assert c.receive.getRuntimeState() == 2
    assert not c.receive.isProtectiveStopped() and not c.receive.isEmergencyStopped()


def target_moment_holds_the_arm_against_gravity(c: ContractClient) -> None:
    assert max(map(abs, c.receive.getTargetMoment())) > 1.0


def move_j(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    goal = c.aside()
    assert c.control.moveJ(goal, 1.0, 3.0)
    assert c.near(goal)
    assert c.control.moveJ(start, 1.0, 3.0)
    assert c.near(start)


def move_j_asynchronously(c: ContractClient) -> None:
    goal = c.aside(0.1)
    before = c.control.getAsyncOperationProgress()
    assert before < 0
    assert c.control.moveJ(goal, 0.5, 2.0, True)
    assert c.wait(lambda: c.control.getAsyncOperationProgress() >= 0)
    assert c.wait(lambda: c.control.getAsyncOperationProgress() < 0)
    assert c.near(goal)
    assert c.control.moveJ(c.aside(-0.1), 1.0, 3.0)


def stop_j_ends_an_asynchronous_move(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    goal = c.aside(0.15)
    assert c.control.moveJ(goal, 0.1, 0.5, True)
    assert c.wait(lambda: c.receive.getTargetQ() != start)
    c.control.stopJ(1.0)
    assert c.at_rest()
    assert np.abs(np.subtract(c.receive.getTargetQ(), goal)).max() > 0.01
    assert c.control.moveJ(start, 1.0, 3.0)


def move_j_to_a_pose(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    goal = c.aside()
    pose = c.control.getForwardKinematics(goal, c.control.getTCPOffset())
    assert c.control.moveJ_IK(pose, 1.0, 3.0)
    assert c.near(goal)
    assert c.control.moveJ(start, 1.0, 3.0)


def move_l(c: ContractClient) -> None:
    start = c.receive.getTargetTCPPose()
    up = [*start[:2], start[2] + 0.03, *start[3:]]
    assert c.control.moveL(up, 0.2, 1.0)
    assert c.wait(lambda: math.dist(c.receive.getActualTCPPose()[:3], up[:3]) < POSE_TOLERANCE_M)
    assert c.control.moveL(start, 0.2, 1.0)
    assert c.wait(lambda: math.dist(c.receive.getActualTCPPose()[:3], start[:3]) < POSE_TOLERANCE_M)


def move_l_to_joints(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    goal = c.aside(0.03)
    assert c.control.moveL_FK(goal, 0.2, 1.0)
    assert c.near(goal)
    assert c.control.moveL_FK(start, 0.2, 1.0)


def move_along_paths(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    goal = c.aside(0.03)
    assert c.control.moveJ([[*goal, 1.0, 3.0, 0.0], [*start, 1.0, 3.0, 0.0]])
    assert c.near(start)
    pose = c.receive.getTargetTCPPose()
    up = [*pose[:2], pose[2] + 0.02, *pose[3:]]
    assert c.control.moveL([[*up, 0.2, 1.0, 0.0], [*pose, 0.2, 1.0, 0.0]])
    assert c.near(start)


def stream_speed_j(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    for _ in range(50):
        begin = c.control.initPeriod()
        assert c.control.speedJ([SPEED, 0.0, 0.0, 0.0, 0.0, -SPEED], 5.0, c.step)
        c.control.waitPeriod(begin)
    assert c.wait(lambda: abs(c.receive.getActualQd()[0] - SPEED) < 0.02)
    assert c.control.speedStop(10.0)
    assert c.at_rest()
    moved = c.receive.getTargetQ()[0] - start[0]
    assert moved > 0.0
    assert c.control.moveJ(start, 1.0, 3.0)


def the_last_speed_is_repeated_until_speed_stop(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    assert c.control.speedJ([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], 5.0, c.step)
    time.sleep(0.3)
    assert c.receive.getTargetQd()[0] == 0.1 or abs(c.receive.getTargetQd()[0] - 0.1) < 1e-6
    assert c.control.speedStop(10.0)
    assert c.at_rest()
    assert c.control.moveJ(start, 1.0, 3.0)


def stream_speed_l(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    for _ in range(50):
        begin = c.control.initPeriod()
        assert c.control.speedL([0.0, 0.0, 0.05, 0.0, 0.0, 0.0], 0.5, c.step)
        c.control.waitPeriod(begin)
    assert c.wait(lambda: abs(c.receive.getTargetTCPSpeed()[2] - 0.05) < 1e-3)
    assert c.control.speedStop(10.0)
    assert c.at_rest()
    assert c.control.moveJ(start, 1.0, 3.0)


def stream_servo_j(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    for k in range(60):
        begin = c.control.initPeriod()
        goal = [start[0] + 0.1 * k * c.step, *start[1:]]
        assert c.control.servoJ(goal, 0.0, 0.0, c.step, 0.03, 500)
        c.control.waitPeriod(begin)
    assert c.near(goal)
    assert c.control.servoStop(5.0)
    assert c.at_rest()
    assert c.control.moveJ(start, 1.0, 3.0)


def stream_servo_l(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    pose = c.receive.getTargetTCPPose()
    for k in range(60):
        begin = c.control.initPeriod()
        goal = [*pose[:2], pose[2] + 0.05 * k * c.step, *pose[3:]]
        assert c.control.servoL(goal, 0.0, 0.0, c.step, 0.05, 300)
        c.control.waitPeriod(begin)
    assert c.wait(lambda: math.dist(c.receive.getActualTCPPose()[:3], goal[:3]) < POSE_TOLERANCE_M)
    assert c.control.servoStop(5.0)
    assert c.control.moveJ(start, 1.0, 3.0)


def servo_c_moves_towards_its_pose(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    pose = c.receive.getTargetTCPPose()
    assert c.control.servoC([*pose[:2], pose[2] + 0.02, *pose[3:]], 0.1, 0.5, 0.0)
    assert c.wait(lambda: c.receive.getTargetQ() != start)
    assert c.at_rest()
    c.dashboard.stop()  # the script says "done" until a command 0: a next call would wait four seconds in vain
    assert c.wait(lambda: not c.control.isProgramRunning())
    assert not c.control.moveJ(start, 1.0, 2.0)  # clears the register: else the next program began with servoC again
    c.ready_again()
    assert c.control.moveJ(start, 1.0, 2.0)


def jog(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    assert c.control.jogStart([0.0, 0.0, 0.02, 0.0, 0.0, 0.0])
    assert c.wait(lambda: c.receive.getTargetQ() != start)
    assert c.control.jogStop()
    assert c.at_rest()
    assert c.control.moveJ(start, 1.0, 3.0)


def the_watchdog_ends_the_program(c: ContractClient) -> None:
    assert c.control.setWatchdog(4.0)  # a quarter of a second: a loaded machine may keep this process waiting for 0.1 s
    assert c.control.speedJ([0.05, 0.0, 0.0, 0.0, 0.0, 0.0], 5.0, c.step)
    assert c.wait(lambda: c.receive.getRuntimeState() != 2)
    assert c.at_rest()
    # each interface has its own copy of the state: this one may see the end a little later
    assert c.wait(lambda: not c.control.speedJ([0.05, 0.0, 0.0, 0.0, 0.0, 0.0], 5.0, c.step))
    c.ready_again()


def two_motions_at_once_end_the_program(c: ContractClient) -> None:
    assert c.control.speedJ([0.05, 0.0, 0.0, 0.0, 0.0, 0.0], 5.0, c.step)
    time.sleep(0.1)
    assert not c.control.moveJ(c.aside(), 1.0, 3.0)
    assert c.wait(lambda: c.receive.getRuntimeState() != 2)
    assert c.at_rest()
    c.ready_again()


def stop_and_upload_again(c: ContractClient) -> None:
    c.control.stopScript()
    assert c.wait(lambda: not c.control.isProgramRunning())
    assert not c.control.moveJ(c.aside(), 1.0, 3.0)
    c.ready_again()
    move_j(c)


def digital_outputs(c: ContractClient) -> None:
    kinds = (c.io.setStandardDigitalOut, 1, 1), (c.io.setConfigurableDigitalOut, 2, 10), (c.io.setToolDigitalOut, 1, 17)
    for call, line, bit in kinds:
        for level in (True, False):
            assert call(line, level)
            assert c.wait(lambda bit=bit, level=level: c.receive.getDigitalOutState(bit) == level), (bit, level)


def custom_scripts(c: ContractClient) -> None:
    """Interpreted by the controller, in the place of the control program, which the client uploads again after it."""
    assert c.control.sendCustomScriptFunction("mine", "  write_output_integer_register(18, 7)\n  sleep(0.02)\n")
    assert c.wait(lambda: c.receive.getOutputIntRegister(18) == 7)
    assert c.control.isProgramRunning()
    assert c.control.isSteady()


def analog_outputs(c: ContractClient) -> None:
    assert c.io.setAnalogOutputVoltage(0, 0.5)
    assert c.wait(lambda: abs(c.receive.getStandardAnalogOutput0() - 0.5) < 1.0)


def speed_slider(c: ContractClient) -> None:
    assert c.io.setSpeedSlider(0.5)
    assert c.wait(lambda: abs(c.receive.getTargetSpeedFraction() - 0.5) < 1e-6)
    assert c.io.setSpeedSlider(1.0)
    assert c.wait(lambda: c.receive.getTargetSpeedFraction() == 1.0)


def input_registers_are_accepted(c: ContractClient) -> None:
    assert c.io.setInputIntRegister(18, 7)
    assert c.io.setInputDoubleRegister(22, 1.5)


def forward_and_inverse_kinematics(c: ContractClient) -> None:
    q = c.aside()
    offset = c.control.getTCPOffset()
    pose = c.control.getForwardKinematics(q, offset)
    np.testing.assert_allclose(c.control.getInverseKinematics(pose, q), q, atol=1e-6)
    np.testing.assert_allclose(c.control.getInverseKinematics(pose), q, atol=1e-6)
    here = c.control.getForwardKinematics()
    np.testing.assert_allclose(here[:3], c.receive.getTargetTCPPose()[:3], atol=POSE_TOLERANCE_M)
    if c.version >= (5, 10) or c.version == (3, 15):
        assert c.control.getInverseKinematicsHasSolution(pose)
        assert not c.control.getInverseKinematicsHasSolution([9.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def tool_centre_point(c: ContractClient) -> None:
    before = c.control.getTCPOffset()
    assert c.control.setTcp([0.0, 0.0, 0.25, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(c.control.getTCPOffset(), [0.0, 0.0, 0.25, 0.0, 0.0, 0.0], atol=1e-9)
    assert c.control.setTcp(before)


def answered(query: Callable[[], list[float]]) -> list[float]:
    """Returns the second answer of a real-time query: the first may be the previous content of the registers."""
    query()
    time.sleep(0.05)
    return query()


def flange_pose_and_pose_trans(c: ContractClient) -> None:
    offset = answered(c.control.getTCPOffset)

    def tool() -> list[float]:
        return c.control.poseTrans(answered(c.control.getActualToolFlangePose), offset)

    assert c.wait(lambda: math.dist(tool()[:3], c.receive.getActualTCPPose()[:3]) < POSE_TOLERANCE_M)


def safety_limits_and_steadiness(c: ContractClient) -> None:
    assert c.control.isJointsWithinSafetyLimits(c.receive.getTargetQ())
    assert not c.control.isJointsWithinSafetyLimits([7.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert c.control.isPoseWithinSafetyLimits(c.receive.getTargetTCPPose())
    assert c.at_rest()
    assert c.wait(c.control.isSteady)


def step_time_history_and_torques(c: ContractClient) -> None:
    if c.version[0] >= 5:
        assert c.wait(lambda: abs(c.control.getStepTime() - c.step) < 1e-9)
        here = c.receive.getActualQ()
        assert c.wait(lambda: math.dist(c.control.getActualJointPositionsHistory(10), here) < MOVE_TOLERANCE_RAD)
    assert len(c.control.getJointTorques()) == 6


def payload(c: ContractClient) -> None:
    assert c.control.setPayload(0.5, [0.0, 0.0, 0.1])
    if c.version[0] < 10:  # the client asks no PolyScope X for them
        assert c.wait(lambda: abs(c.receive.getPayload() - 0.5) < 1e-6)
        np.testing.assert_allclose(c.receive.getPayloadCog(), [0.0, 0.0, 0.1], atol=1e-6)
    assert c.control.setPayload(1.0, [0.0, 0.0, 0.05])
    assert c.control.setGravity([0.0, 0.0, 9.82])


def force_and_teach_modes_are_accepted(c: ContractClient) -> None:
    assert c.control.zeroFtSensor()
    assert c.control.forceModeSetDamping(0.1)
    assert c.control.forceModeSetGainScaling(0.5)
    free = [0.0] * 6
    assert c.control.forceMode(free, [0] * 6, free, 2, [0.1] * 6)
    assert c.control.forceModeStop()
    assert c.control.teachMode()
    assert c.control.endTeachMode()
    if c.version >= (5, 10):
        assert c.control.freedriveMode()
        assert c.control.endFreedriveMode()
        assert c.control.getFreedriveStatus() == 0
    assert c.at_rest()


def dashboard(c: ContractClient) -> None:
    d = c.dashboard
    if isinstance(d, PlainCommands):
        return
    assert d.robotmode() == "Robotmode: RUNNING"
    assert d.safetymode() == "Safetymode: NORMAL"
    assert d.programState().startswith("PLAYING")
    assert d.running()
    assert d.getRobotModel().startswith("UR")
    if c.version > (5, 5):
        assert d.getSerialNumber().isdigit()
        assert d.isInRemoteControl()
        assert d.safetystatus() == "Safetystatus: NORMAL"
    d.popup("contract")
    d.closePopup()
    d.addToLog("contract")


def pause_and_play(c: ContractClient) -> None:
    c.dashboard.pause()
    assert c.wait(lambda: c.receive.getRuntimeState() == 4)
    assert not c.control.moveJ(c.aside(), 1.0, 3.0)
    c.dashboard.play()
    assert c.wait(lambda: c.receive.getRuntimeState() == 2)
    c.ready_again()


def the_registers_of_a_control_client_are_in_use(c: ContractClient) -> None:
    with pytest.raises(RuntimeError, match="already in use"):
        rtde_control.RTDEControlInterface(c.host)
    c.ready_again()


def protective_stop(c: ContractClient) -> None:
    c.control.triggerProtectiveStop()
    assert c.wait(c.receive.isProtectiveStopped)
    assert not c.control.moveJ(c.aside(), 1.0, 3.0)
    assert c.receive.getSafetyMode() == 3
    assert c.receive.getSafetyStatusBits() & 1 << 2
    if not isinstance(c.dashboard, PlainCommands):
        with pytest.raises((RuntimeError, ValueError), match="Cannot unlock"):
            c.dashboard.unlockProtectiveStop()
    assert c.wait(lambda: unlocked(c))  # this suite's simulator locks for 1 s, a real controller for 5 s
    assert c.wait(lambda: not c.receive.isProtectiveStopped())
    c.ready_again()


def unlocked(c: ContractClient) -> bool:
    """Requests the end of the protective stop; returns whether it was granted."""
    try:
        c.dashboard.unlockProtectiveStop()
    except (RuntimeError, ValueError):
        return False
    return True


def move_until_contact(c: ContractClient) -> None:
    start = c.receive.getTargetQ()
    assert c.control.moveUntilContact([0.0, 0.0, -0.8, 0.0, 0.0, 0.0], [0.0] * 6, 5.0)
    assert c.at_rest()
    assert c.receive.getActualTCPPose()[2] < 0.01
    assert c.control.moveJ(start, 2.0, 8.0)


def matrices_come_in_two_ranges_of_registers(c: ContractClient) -> None:
    if c.version < (5, 23):
        return
    assert c.wait(lambda: np.any(c.control.getMassMatrix()))  # the client may read the registers of the state before
    inertia = np.reshape(c.control.getMassMatrix(), (6, 6), order="F")
    assert np.allclose(inertia, inertia.T, atol=1e-9)
    assert (np.linalg.eigvalsh(inertia) > 0.0).all()
    assert c.control.getCoriolisAndCentrifugalTorques() == pytest.approx([0.0] * 6, abs=1e-9)
    assert len(c.control.getTargetJointAccelerations()) == 6
    q = c.receive.getTargetQ()
    tool = c.control.getTCPOffset()
    columns = np.zeros((3, 6))
    for joint in range(6):
        ahead = [a + 1e-4 * (i == joint) for i, a in enumerate(q)]
        behind = [a - 1e-4 * (i == joint) for i, a in enumerate(q)]
        moved = np.subtract(c.control.getForwardKinematics(ahead, tool), c.control.getForwardKinematics(behind, tool))
        columns[:, joint] = moved[:3] / 2e-4

    def is_jacobian() -> bool:  # on a busy machine the registers may be of the call before
        seen = np.reshape(c.control.getJacobian(), (6, 6), order="F")
        return np.allclose(seen[:3], columns, atol=1e-3, rtol=1e-6)

    assert c.wait(is_jacobian)
    assert np.allclose(c.control.getJacobianTimeDerivative(), 0.0, atol=1e-6)


CALLS = (
    matrices_come_in_two_ranges_of_registers,
    receives_every_variable,
    time_advances_cycle_by_cycle,
    is_in_normal_operation,
    target_moment_holds_the_arm_against_gravity,
    move_j,
    move_j_asynchronously,
    stop_j_ends_an_asynchronous_move,
    move_j_to_a_pose,
    move_l,
    move_l_to_joints,
    move_along_paths,
    stream_speed_j,
    the_last_speed_is_repeated_until_speed_stop,
    stream_speed_l,
    stream_servo_j,
    stream_servo_l,
    servo_c_moves_towards_its_pose,
    jog,
    the_watchdog_ends_the_program,
    two_motions_at_once_end_the_program,
    stop_and_upload_again,
    digital_outputs,
    analog_outputs,
    custom_scripts,
    speed_slider,
    input_registers_are_accepted,
    forward_and_inverse_kinematics,
    tool_centre_point,
    flange_pose_and_pose_trans,
    safety_limits_and_steadiness,
    step_time_history_and_torques,
    payload,
    force_and_teach_modes_are_accepted,
    dashboard,
    pause_and_play,
    the_registers_of_a_control_client_are_in_use,
)
SIMULATED_ONLY = (protective_stop,)
