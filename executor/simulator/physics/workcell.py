"""The physical workcell: the arm with its true tool, outputs, gripper and objects, advanced cycle by cycle."""

from __future__ import annotations

from executor.simulator.physics import kinematics
from executor.simulator.physics.arm import Arm
from executor.simulator.physics.gripper import SimulatedGripper
from executor.simulator.physics.kinematics import KinematicChain
from executor.simulator.physics.lag import Lag
from executor.simulator.physics.outputs import Outputs
from executor.simulator.physics.world import World
from executor.simulator.settings import SimulatorSettings
from planner.cell import Cell


class Workcell:
    """The true arm, tool, outputs, gripper and objects, as opposed to the controller's belief.

    Attributes:
        moved_at: controller time of the last cycle in which the arm truly moved [s].
        tool: true pose of the tool centre point in the flange.
        base: true pose of the base in the world.
    """

    def __init__(self, cell: Cell, settings: SimulatorSettings, dt: float) -> None:
        self.dt = dt
        self.moved_at = 0.0
        home, sim, gripper = cell.home.tolist(), cell.sim, cell.gripper
        lag = Lag(dt, sim.lag_s, settings.first_order_s, home)
        noise = (settings.position_noise_rad, settings.velocity_noise_rad_s)
        self.arm = Arm(KinematicChain(cell.robot), dt, home, lag, noise, sim.seed)
        timing = (sim.gripper_delay_s, sim.gripper_jitter_s, sim.seed)
        self.gripper = SimulatedGripper(gripper.output, gripper.index, gripper.open_level, *timing)
        self.outputs = Outputs(dt, sim.lag_s, self.gripper.closed_bits)
        self.world = World(cell, settings.restitution)
        self.tool = kinematics.from_matrix(cell.tool.X_FT)
        self.base = kinematics.from_matrix(cell.X_WB)

    def cycle(self, t: float) -> None:
        """Advances everything to the end of the cycle at `t` [s]: the arm follows its command, objects fly."""
        self.arm.finish_cycle()
        if self.arm.moves:
            self.moved_at = t
        for at, bits in self.outputs.cycle(t):
            self.gripper.output_changed(at, bits)
        self.world.cycle(t, self.dt)
        left_at = self.gripper.take_release(t)
        if left_at is not None:
            self.world.release(self.gripper.let_go(), left_at, self._object_state(t - left_at), t)
        self.gripper.rearm(self.arm.at_rest)

    def _object_state(self, back_s: float) -> tuple[float, ...]:
        """Returns position and velocity of the held object in the world, `back_s` [s] ago."""
        pose, twist = self.arm.true_motion_before(min(back_s, self.dt), self.tool)
        b = self.base
        point = kinematics.product(b, pose)
        velocity = [b[r] * twist[0] + b[r + 1] * twist[1] + b[r + 2] * twist[2] for r in (0, 4, 8)]
        return (point[3], point[7], point[11], *velocity)

    def in_contact(self) -> bool:
        """Whether the tool centre point is in the floor or in a keep-out box."""
        point = kinematics.product(self.base, self.arm.chain.forward(self.arm.true_q, self.tool))
        return self.world.solid_at((point[3], point[7], point[11]))
