"""Pictures of the report: cumulative shares, which show the tails."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np

from benchmarks.results import ResultRow

GROUPS = ("pose", "point", "target")
SHOWN = ("auto", "casadi", "ruckig", "toppra", "trapezoid", "cubic", "ramp")
COLOURS: dict[str, str] = dict(
    zip(SHOWN, ("#0b7285", "#5f3dc4", "#e8590c", "#2b8a3e", "#868e96", "#adb5bd", "#ced4da"), strict=True)
)


def draw(out: Path, rows: Sequence[ResultRow]) -> None:
    """Writes release-time.svg, solve-time.svg and window.svg."""
    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "fling", "font.size": 9})
    _release_times(out / "release-time.svg", rows)
    _solve_times(out / "solve-time.svg", rows)
    _windows(out / "window.svg", rows)


def _panels(titles: Sequence[str], label: str):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(titles), figsize=(3.6 * len(titles), 3.0), sharey=True, layout="constrained")
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(title)
        axis.set_xlabel(label)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("share of plans")
    return figure, axes


def _cumulative(axis, values: Sequence[float], name: str, style: str = "-", label: str = "") -> None:
    if len(values):
        share = np.arange(1, len(values) + 1) / len(values)
        axis.step(np.sort(values), share, where="post", label=label or name, color=COLOURS[name], linestyle=style)


def _save(figure, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def _release_times(path: Path, rows: Sequence[ResultRow]) -> None:
    figure, axes = _panels(GROUPS, "release time / Ruckig's")
    for axis, group in zip(axes, GROUPS, strict=True):
        own = [r for r in rows if r.group == group and r.certified]
        ruckig = {r.task: r.release_time_s for r in own if r.backend == "ruckig"}
        for name in SHOWN:
            if name != "ruckig":
                ratios = [r.release_time_s / ruckig[r.task] for r in own if r.backend == name and r.task in ruckig]
                _cumulative(axis, ratios, name)
        axis.set_xlim(0.2, 2.0)
        axis.axvline(1.0, color=COLOURS["ruckig"], linewidth=0.8)
    axes[0].legend(fontsize=7)
    _save(figure, path)


def _solve_times(path: Path, rows: Sequence[ResultRow]) -> None:
    figure, axes = _panels(GROUPS, "time to a plan [ms]")
    for axis, group in zip(axes, GROUPS, strict=True):
        for name in SHOWN:
            _cumulative(axis, [1000 * r.solve_s for r in rows if (r.group, r.backend) == (group, name)], name)
        axis.set_xscale("log")
    axes[0].legend(fontsize=7)
    _save(figure, path)


def _windows(path: Path, rows: Sequence[ResultRow]) -> None:
    widths = ("10", "20", "30")
    figure, axes = _panels([f"±{w} ms" for w in widths], "worst landing error [mm]")
    for axis, width in zip(axes, widths, strict=True):
        for group, style in (("target", "-"), ("robust", "--")):
            for name in ("auto", "ruckig"):
                chosen = [r for r in rows if (r.group, r.backend) == (group, name) and r.certified]
                _cumulative(axis, [1000 * r.window_m[width] for r in chosen], name, style, f"{group}, {name}")
        axis.set_xscale("log")
    axes[0].legend(fontsize=7)
    _save(figure, path)
