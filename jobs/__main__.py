"""`python -m jobs ID`: the driver of one batch, as the service starts it; ends with its parent.

SIGTERM stops it: what is planned is stored, and the batch can be taken up again. Exit status 0: the batch is finished
or released; 1: it cannot be planned, with the reason on standard error.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys

from jobs.batches import BatchDriver, wait_and_claim
from jobs.planning import end_with_starter
from jobs.pool import PoolBroken
from store import BatchDriven, BatchLost, Store, StoreError, default_database_url


def main() -> int:
    """Drives one batch. Returns the exit status of the process."""
    arguments = _arguments()
    end_with_starter()
    try:
        store = Store.open(os.environ.get("FLING_DATABASE_URL") or default_database_url())
        row = wait_and_claim(store, arguments.id, arguments.driver)
        driver = BatchDriver(store, row, arguments.workers, arguments.ray)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: driver.stop())
        driver.run()
    except (BatchDriven, BatchLost) as error:  # somebody else's
        print(f"fling: {error}", file=sys.stderr)
        return 0
    except (StoreError, RuntimeError, PoolBroken) as error:
        print(f"fling: batch {arguments.id}: {error}", file=sys.stderr)
        return 1
    store.close()
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m jobs", description="Plans one batch of FLING_DATABASE_URL.")
    parser.add_argument("id", help="id of the batch")
    parser.add_argument("--driver", default=f"process {os.getpid()}", help="name of this driver")
    parser.add_argument("--workers", type=int, help="number of planner processes; default: one a core")
    parser.add_argument("--ray", help="address of a Ray cluster")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
