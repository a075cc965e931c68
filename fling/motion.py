"""The joint motion of a plan, for a notebook: as a table, a figure, or a file."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import planner.trajectory
from planner.robots import JOINT_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

QUANTITIES = {"q": "position_rad", "qd": "velocity_rad_s", "qdd": "acceleration_rad_s2"}
AXES = {"q": "position [rad]", "qd": "velocity [rad/s]", "qdd": "acceleration [rad/s²]"}


@dataclass(frozen=True, eq=False)
class Trajectory(planner.trajectory.Trajectory):
    """Joint motion on the controller's ticks, from the start to standstill, with one constant jerk a tick.

    Attributes:
        sample_rate_hz: ticks per second.
        q: positions (N, n) [rad]; sample i is at i / sample_rate_hz.
        qd: velocities (N, n) [rad/s].
        qdd: accelerations (N, n) [rad/s^2].
        release_index: sample at which the object leaves; the last one for a move that ends at rest.
        passage_indices: samples of the passages; empty: the release is the only one.
        joint_names: of the n joints; those of UR's ROS driver.

    Raises:
        ValueError: the arrays have different shapes, or the release is not a sample.
    """

    joint_names: tuple[str, ...] = JOINT_NAMES

    def __repr__(self) -> str:
        """Returns the motion in a line."""
        samples = f"{len(self.q)} samples at {self.sample_rate_hz:g} Hz"
        what = "passages" if self.passage_indices else "release"
        times = ", ".join(f"{self.t[index]:.3f}" for index in self.passed)
        return f"<Trajectory {samples}: {what} at {times} s of {self.duration_s:.3f} s>"

    def to_frame(self) -> DataFrame:
        """Returns a pandas frame: one row a tick, indexed by time [s], columns such as `elbow_joint_velocity_rad_s`.

        Raises:
            ImportError: pandas is not installed.
        """
        pandas = _notebook_module("pandas")
        header, *rows = self._table()
        return pandas.DataFrame(rows, columns=header).set_index("time_s")

    def to_csv(self, path: str | Path) -> None:
        """Writes the samples to a file, with the columns of `to_frame`."""
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(self._table())

    def plot(self) -> Figure:
        """Returns a matplotlib figure of position, velocity and acceleration over time, with release and passages.

        Raises:
            ImportError: matplotlib is not installed.
        """
        figure = _notebook_module("matplotlib.figure").Figure(figsize=(8.0, 7.0), layout="constrained")
        for axes, (name, label) in zip(figure.subplots(3, 1, sharex=True), AXES.items(), strict=True):
            axes.plot(self.t, getattr(self, name), label=self.joint_names)
            for index in self.passed:
                axes.axvline(self.t[index], color="black", linestyle="--", linewidth=0.8)
            axes.set_ylabel(label)
            axes.grid(alpha=0.3)
        figure.axes[0].legend(fontsize="small", ncols=3)
        figure.axes[-1].set_xlabel("time [s]; dashed: release, or passages")
        return figure

    def _table(self) -> Iterator[list[Any]]:
        """Yields the header and one row a tick."""
        names = [f"{joint}_{quantity}" for quantity in QUANTITIES.values() for joint in self.joint_names]
        yield ["time_s", *names]
        for i, t in enumerate(self.t):
            yield [float(t), *self.q[i].tolist(), *self.qd[i].tolist(), *self.qdd[i].tolist()]


def _notebook_module(name: str) -> Any:
    """Returns a module of the extra `notebook`.

    Raises:
        ImportError: it is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise ImportError(f"{package} is not installed: pip install 'fling-robotics[notebook]'") from error
