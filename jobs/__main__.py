"""`python -m jobs batch ID`, `python -m jobs map ID`: drives one batch or map, as the service starts it.

It ends with its parent. SIGTERM stops it: what is planned is stored, and the next driver resumes. Exit status 0: the
batch or map is finished, or left to another driver; 1: it cannot be planned, with the reason on standard error.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading

from fling import this_machine
from jobs import driver
from jobs.batches import DrivenBatch, wait_and_claim
from jobs.maps import DrivenMap, map_inputs
from jobs.pool import PoolBroken, end_with_starter
from store import BatchDriven, BatchLost, Store, StoreError


def main() -> int:
    """Drives one batch or map. Returns the exit status of the process."""
    arguments = _arguments()
    end_with_starter()
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    try:
        store = Store.open(this_machine.database_url(os.environ))
        driver.run(_driven(store, arguments), arguments.workers, arguments.ray, stop.is_set)
    except (BatchDriven, BatchLost) as error:  # another driver has it, or it is finished
        print(f"fling: {error}", file=sys.stderr)
        return 0
    except (StoreError, RuntimeError, LookupError, PoolBroken) as error:
        print(f"fling: {arguments.kind} {arguments.id}: {error}", file=sys.stderr)
        return 1
    store.close()
    return 0


def _driven(store: Store, arguments: argparse.Namespace) -> driver.Drivable:
    """Returns what is to be driven.

    Raises:
        LookupError: there is no such map.
        StoreError: there is no such batch, or another driver has it.
    """
    if arguments.kind == "batch":
        return DrivenBatch(store, wait_and_claim(store, arguments.id, arguments.driver))
    row = store.map(arguments.id)
    if row is None:
        raise LookupError("there is no such map")
    return DrivenMap(store, row, map_inputs(store, row))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m jobs", description="Plans what is in FLING_DATABASE_URL.")
    parser.add_argument("kind", choices=("batch", "map"))
    parser.add_argument("id", help="id of the batch or map")
    parser.add_argument("--driver", default=f"process {os.getpid()}", help="name of this driver")
    parser.add_argument("--workers", type=int, help="number of planner processes; default: one a core")
    parser.add_argument("--ray", help="address of a Ray cluster")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
