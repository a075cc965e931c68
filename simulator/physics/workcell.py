"""The physical workcell: the arm with its true tool, outputs, gripper and objects, advanced cycle by cycle."""

from __future__ import annotations

import random
from collections.abc import Sequence

from planner.cell import Cell
from simulator.physics import kinematics
from simulator.physics.arm import Arm, Response
from simulator.physics.controller_kinematics import controller_table
from simulator.physics.feeder import Feeder
from simulator.physics.gripper import SimulatedGripper
from simulator.physics.kinematics import KinematicChain, Transform
from simulator.physics.lag import Lag
from simulator.physics.outputs import Outputs, SwitchedDevice
from simulator.physics.overshoot import NO_SCATTER, Overshoot, Scatter
from simulator.physics.world import Attitude, State, World
from simulator.settings import SimulatorSettings
from simulator.truth import Truth

# The arm as measured: 211 recorded throws of a real UR5 (CB3, 125 Hz, speedj). Replayed throws have the same overshoot,
# the same residual after the commanded peak, the same scatter of the lag: docs/simulator.md, "The arm as measured".
UR5_OVERSHOOT = 0.024  # [-] gives measured over commanded peaks of 1.02 in the median
UR5_SCATTER = Scatter(speed_share=0.02, correlation_s=0.008, lag_std_s=0.00035)


class Workcell:
    """The true arm, tool, outputs, gripper and objects, as opposed to the controller's belief.

    Attributes:
        truth: how all of it really behaves.
        feeder: of the objects that the gripper picks up; None: it always has the next one.
        devices: what the outputs of the cell's `[outputs]` switch, by name.
        input_bits: levels of the digital inputs.
        moved_at: controller time of the last cycle in which the arm truly moved [s].
        grippers, tools: all grippers of the tool, and the true poses of their tool centre points in the flange, by
            name; the cell's own is "".
        tool: that of the cell's own.
        base: true pose of the base in the world.
    """

    def __init__(self, cell: Cell, settings: SimulatorSettings, truth: Truth, dt: float) -> None:
        self.dt = dt
        self.truth = truth
        self.moved_at = 0.0
        home = cell.home.tolist()
        timing = truth.timing
        noise = (settings.position_noise_rad, settings.velocity_noise_rad_s)
        chain = KinematicChain(controller_table(cell.robot, truth.arm.dh_deviation))
        self.arm = Arm(chain, dt, home, _response(truth, dt, home), noise, truth.seed)
        self.feeder = None if truth.feed is None else Feeder(truth.feed, truth.seed, truth.camera)
        takes = None if self.feeder is None else self._take
        names = list(cell.grippers) or [""]
        of_own = (cell.gripper, 2.0 * cell.object.radius_m, truth.gripper, truth.seed)
        self.gripper = SimulatedGripper(*of_own, takes, 0, len(names))
        self.grippers = {"": self.gripper}
        self.tools = {"": kinematics.from_matrix(cell.tool.X_FT)}
        for place, name in enumerate(names[1:], start=1):
            each = cell.grippers[name]
            of_each = (each.gripper, 2.0 * each.object.radius_m, truth.grippers[name], f"{truth.seed} {name}")
            self.grippers[name] = SimulatedGripper(*of_each, None, place, len(names))
            self.tools[name] = kinematics.from_matrix(each.X_FT)
        first = sum(each.first_bits for each in self.grippers.values())
        self.outputs = Outputs(dt, timing.output_delay_s, first)
        self.devices = {
            name: SwitchedDevice(each, truth.outputs[name], self.outputs.bits, f"{truth.seed} output {name}")
            for name, each in cell.outputs.items()
        }
        self._grip_bit = 0 if cell.gripper.grip_input is None else 1 << cell.gripper.grip_input
        self._gripped = self.gripper.holds is not None
        self.input_bits = sum(device.input_bits for device in self.devices.values())
        self.input_bits |= self._grip_bit if self._gripped else 0
        self.world = World(cell, settings.restitution, truth)
        self.tool = self.tools[""]
        self.base = _true_base(kinematics.from_matrix(cell.X_WB), truth)
        self._clings = random.Random(f"{truth.seed} cling")

    def cycle(self, t: float) -> None:
        """Advances everything to the end of the cycle at `t` [s]: the arm follows its command, objects fly."""
        self.arm.finish_cycle()
        if self.arm.moves:
            self.moved_at = t
        for at, bits in self.outputs.cycle(t):
            for gripper in self.grippers.values():
                gripper.output_changed(at, bits)
            for device in self.devices.values():
                device.output_changed(at, bits)
        for device in self.devices.values():
            self.input_bits = device.sensed(t, self.input_bits)
        if self.feeder is not None:
            self.feeder.cycle(t)
        for gripper in self.grippers.values():
            gripper.cycle(t, self.outputs.delay_s, self.dt)
        self.world.cycle(t, self.dt)
        self._let_go(t)
        self._sense_grip()

    def _let_go(self, t: float) -> None:
        """Lets every object fly that has left its gripper up to `t` [s]; an empty one takes the next."""
        for name, gripper in self.grippers.items():
            left_at = gripper.take_release(t)
            if left_at is not None:
                state, attitude = self._leaving(t - left_at, name)
                self.world.release(gripper.let_go(), left_at, state, t, attitude, name)
            gripper.rearm(self.arm.stands)

    def _sense_grip(self) -> None:
        """Switches the input that shows whether the gripper holds an object, where that has changed."""
        if self._gripped == (self.gripper.holds is not None):
            return
        self._gripped = not self._gripped
        self.input_bits = self.input_bits | self._grip_bit if self._gripped else self.input_bits & ~self._grip_bit

    def _take(self, t: float) -> int | None:
        """Returns the number of the object on which the gripper closes at `t` [s]; None for none."""
        assert self.feeder is not None
        point = self._tool_point(self.arm.true_q)
        return self.feeder.take(t, (point[3], point[7], point[11]))

    def lose_object(self, t: float) -> None:
        """Fault: the held object slips out of the gripper at `t` [s]."""
        number = self.gripper.lose()
        if number is not None:
            state, attitude = self._leaving(0.0)
            self.world.release(number, t, state, t, attitude)

    def _leaving(self, back_s: float, gripper: str = "") -> tuple[State, Attitude]:
        """Returns with which state and attitude in the world the object of a gripper left, `back_s` [s] ago."""
        pose, twist = self.arm.true_motion_before(min(back_s, self.dt), self.tools[gripper])
        b = self.base
        point = kinematics.product(b, pose)
        factor = 1.0 if gripper else self._speed_factor()
        velocity = [factor * (b[r] * twist[0] + b[r + 1] * twist[1] + b[r + 2] * twist[2]) for r in (0, 4, 8)]
        spin = [b[r] * twist[3] + b[r + 1] * twist[4] + b[r + 2] * twist[5] for r in (0, 4, 8)]
        return (point[3], point[7], point[11], *velocity), Attitude(point, spin)

    def _speed_factor(self) -> float:
        """Returns the speed of the leaving object over that of the tool centre point."""
        release = self.truth.release
        clings = self._clings.random() < release.cling_share
        return release.speed_factor * (release.cling_speed_factor if clings else 1.0)

    def in_contact(self, q: Sequence[float] | None = None) -> bool:
        """Whether the tool centre point is in the floor or in a keep-out shape, at joint positions `q` or the true."""
        point = self._tool_point(self.arm.true_q if q is None else q)
        return self.world.solid_at((point[3], point[7], point[11]))

    def _tool_point(self, q: Sequence[float]) -> Transform:
        """Returns the true pose of the tool centre point in the world at joint positions."""
        return kinematics.product(self.base, self.arm.chain.forward(q, self.tool))


def _response(truth: Truth, dt: float, home: list[float]) -> Response:
    """Returns how the arm's motion follows its commands."""
    timing = truth.timing
    arm = truth.arm
    lag = Lag(dt, timing.lag_s, timing.first_order_s, home)
    overshoot = list(arm.overshoot)
    scatter = NO_SCATTER
    if arm.disturbance == "ur5-measured":
        overshoot = [x + UR5_OVERSHOOT for x in overshoot]
        scatter = UR5_SCATTER
    if not any(overshoot) and scatter is NO_SCATTER:
        return Response(timing.gain, lag)
    return Response(timing.gain, lag, Overshoot(dt, overshoot, scatter, f"{truth.seed} disturbance"))


def _true_base(believed: Transform, truth: Truth) -> Transform:
    """Returns the true pose of the base in the world: moved and turned against that of the cell file."""
    dx, dy, dz = truth.arm.base_offset_m
    turned = kinematics.transform([0.0, 0.0, 0.0, *truth.arm.base_rotation_vector_rad])
    r0, r1, r2, _, r4, r5, r6, _, r8, r9, r10, _ = kinematics.product(turned, believed)
    return (r0, r1, r2, believed[3] + dx, r4, r5, r6, believed[7] + dy, r8, r9, r10, believed[11] + dz)
