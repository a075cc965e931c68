"""Where the cell files are unless a setting says otherwise: one answer for the service and the executor."""

from __future__ import annotations

import sys
from pathlib import Path


def default_cells_folder() -> Path:
    """Returns `cells` here, or in the checkout, or where an installed Fling keeps its own."""
    checkout = Path(__file__).parent.parent / "cells"
    candidates = (Path("cells"), checkout, Path(sys.prefix) / "share" / "fling" / "cells")
    return next((folder for folder in candidates if any(folder.glob("*.toml"))), checkout).resolve()
