"""`python -m jobs.maps ID`: makes one map that was begun, as the service starts it; ends with its parent.

It may be killed at any time: what was answered half a second before is stored, and whoever makes the map next goes on.
Exit status 0: the map is finished or cancelled; 1: it cannot be made, with the reason on standard error.
"""

from __future__ import annotations

import argparse
import os
import sys

from jobs.maps.making import make_map
from jobs.maps.opening import map_inputs
from jobs.planning import end_with_starter
from jobs.pool import PoolBroken, open_pool
from store import Store, StoreError, default_database_url


def main() -> int:
    """Makes one map. Returns the exit status of the process."""
    arguments = _arguments()
    end_with_starter()
    try:
        store = Store.open(os.environ.get("FLING_DATABASE_URL") or default_database_url())
        _make(store, arguments)
    except (StoreError, RuntimeError, PoolBroken) as error:
        print(f"fling: map {arguments.id}: {error}", file=sys.stderr)
        return 1
    store.close()
    return 0


def _make(store: Store, arguments: argparse.Namespace) -> None:
    """Makes the map.

    Raises:
        RuntimeError: there is no such map.
    """
    row = store.map(arguments.id)
    if row is None:
        raise RuntimeError("there is no such map")
    with open_pool(arguments.workers, arguments.ray) as pool:
        make_map(store, row, map_inputs(store, row), pool.plan_all)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m jobs.maps", description="Makes one map of FLING_DATABASE_URL.")
    parser.add_argument("id", help="id of the map")
    parser.add_argument("--workers", type=int, help="number of planner processes; default: one a core")
    parser.add_argument("--ray", help="address of a Ray cluster")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
