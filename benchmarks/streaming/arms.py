"""Arms of the streaming benchmarks: the ideal one of the cell file, and one as measured on a real UR5."""

from __future__ import annotations

from pathlib import Path

IDEAL = "ideal arm"
MEASURED = "arm as measured on a real UR5"
TRUTHS = {IDEAL: "", MEASURED: '[arm]\ndisturbance = "ur5-measured"\n'}


def simulator_options(folder: Path, arm: str) -> list[str]:
    """Returns the simulator's options for an arm; its truth file goes into the folder, and is revealed."""
    if not TRUTHS[arm]:
        return []
    file = folder / "arm.truth"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(TRUTHS[arm])
    return ["--truth", str(file), "--reveal"]
