"""Hidden cells: what gripper, arm, object, base and camera truly do, apart from what the estimators assume.

Truth is computed from the trajectory's own samples, the planner's kinematics and the integrated flight with drag; the
estimators' tables are not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.learning.plans import PlannedThrow
from planner.flight import drag_constant, landing_points
from planner.geometry import tool_pose
from planner.kinematics import jacobian

SENSOR_RAD_S = 0.005  # [rad/s] error of a recorded joint speed
QUANTUM_S = 0.010  # [s] of a gripper behind a bus; source: docs/learning.md
DRAWS = 20_000  # openings from which mean and standard deviation of a gripper's real delay are computed
SHAPES = ("gaussian", "skewed", "rounded", "bus")


@dataclass(frozen=True, eq=False)
class HiddenCell:
    """Truth of one cell.

    Attributes:
        delay_s, jitter_s, shape: of the gripper before quantisation [s, s].
        assumed_delay_s: the cell file's [s].
        factor: release speed over the tool's [-].
        gain: of each joint (6,) [-].
        noise_rad_s: scatter of each joint's speed [rad/s].
        offset: of the base (2,) [m].
        turn_rad: of the base [rad].
        drag: coefficient [-].
        cling_share: share of throws in which the object leaves 3 to 8 % slower [-].
        outlier_share: of the camera [-].
    """

    delay_s: float
    jitter_s: float
    shape: str
    assumed_delay_s: float
    factor: float
    gain: np.ndarray
    noise_rad_s: float
    offset: np.ndarray
    turn_rad: float
    drag: float
    cling_share: float
    outlier_share: float

    def openings(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Real delays of the gripper (count,) [s]."""
        if self.shape == "skewed":
            drawn = self.delay_s + self.jitter_s * (rng.gamma(2.0, size=count) - 2.0) / math.sqrt(2.0)
        else:
            drawn = self.delay_s + self.jitter_s * rng.standard_normal(count)
        if self.shape == "rounded":
            return QUANTUM_S * np.round(drawn / QUANTUM_S)
        if self.shape == "bus":
            return drawn + rng.uniform(-0.5, 0.5, count) * QUANTUM_S
        return drawn

    def true_delay(self) -> tuple[float, float]:
        """Mean and standard deviation of the real delay, quantisation included [s]."""
        drawn = self.openings(np.random.default_rng(0), DRAWS)
        return float(drawn.mean()), float(drawn.std())


@dataclass(frozen=True, eq=False)
class TrueThrow:
    """One throw: where it landed (2,) [m], where the camera saw it, and the recorded deviation of speeds (6,)."""

    landing: np.ndarray
    seen: np.ndarray
    deviation: np.ndarray


def hidden_cell(
    rng: np.random.Generator, misspecified: bool = False, off_s: float | None = None, poor: bool = False
) -> HiddenCell:
    """Returns a cell at random.

    Args:
        rng: of the cell.
        misspecified: the base is turned, objects cling, joints scatter more.
        off_s: by how much the cell file's delay is off; None: as the prior says, normal with 20 ms.
        poor: a fifth of the camera's observations are mistaken.
    """
    delay = rng.uniform(0.020, 0.120)
    off = rng.normal(0.0, 0.020) if off_s is None else rng.choice([-1.0, 1.0]) * off_s
    return HiddenCell(
        delay_s=delay,
        jitter_s=rng.uniform(0.0, 0.008),
        shape=str(rng.choice(SHAPES, p=(1 / 3, 1 / 3, 1 / 6, 1 / 6))),
        assumed_delay_s=delay + off,
        factor=rng.uniform(0.96, 1.04),
        gain=rng.normal(1.01, 0.01, 6),
        noise_rad_s=rng.uniform(0.02, 0.05) if misspecified else rng.uniform(0.005, 0.025),
        offset=rng.uniform(-0.008, 0.008, 2),
        turn_rad=rng.normal(0.0, math.radians(0.34)) if misspecified else 0.0,
        drag=rng.uniform(0.0, 0.5),
        cling_share=0.08 if misspecified else 0.0,
        outlier_share=0.20 if poor else 0.05,
    )


def throw(
    rng: np.random.Generator, cell: HiddenCell, planned: PlannedThrow, late_s: float, shift: np.ndarray
) -> TrueThrow:
    """Throws once.

    Args:
        rng: of the throw.
        cell: truth.
        planned: the plan.
        late_s: release after the planned one [s].
        shift: by which the aim was moved (2,) [m].
    """
    problem = planned.problem
    trajectory = planned.trajectory
    q, qd, _ = trajectory.at(trajectory.release_time_s + late_s)
    nominal = trajectory.qd[trajectory.release_index]
    scatter = cell.noise_rad_s * rng.standard_normal(6)
    slow = 1.0 - (rng.uniform(0.03, 0.08) if rng.random() < cell.cling_share else 0.0)
    station = problem.cell
    J = station.X_WB[:3, :3] @ jacobian(station.robot, q, station.tool.X_FT)[:3]
    v = cell.factor * slow * J @ (cell.gain * qd + scatter)
    k = drag_constant(station.object.mass_kg, station.object.radius_m, cell.drag)
    point = landing_points(tool_pose(station, q)[None, :3, 3], v[None], problem.plane_z, problem.gravity, k)[0, :2]
    c = math.cos(cell.turn_rad)
    s = math.sin(cell.turn_rad)
    base = station.X_WB[:2, 3]
    landing = base + np.array([[c, -s], [s, c]]) @ (point - base) + cell.offset + shift
    seen = landing + 0.003 * rng.standard_normal(2)
    if rng.random() < cell.outlier_share:
        seen = seen + 0.2 / math.sqrt(2.0) * rng.standard_normal(2)
    deviation = (cell.gain - 1.0) * nominal + scatter + SENSOR_RAD_S * rng.standard_normal(6)
    return TrueThrow(landing, seen, deviation)
