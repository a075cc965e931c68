"""`python healthy.py service | executor | simulator`: exit status 0 if this container's process does its work."""

from __future__ import annotations

import os
import subprocess
import sys
import urllib.request

TIMEOUT_S = 4.0  # [s] below that of the health checks


def service() -> bool:
    """Returns whether the service can plan and reach its store."""
    url = f"http://127.0.0.1:{os.environ.get('FLING_PORT', '8000')}/readyz"
    with urllib.request.urlopen(url, timeout=TIMEOUT_S) as answer:
        return answer.status == 200


def executor() -> bool:
    """Returns whether the executor of this container's cell reported to the store a moment ago."""
    from store import Store

    store = Store.open(os.environ["FLING_DATABASE_URL"])
    try:
        row = store.cell_status(os.environ["FLING_DEFAULT_CELL"])
        return row is not None and row.is_alive
    finally:
        store.close()


def simulator() -> bool:
    """Returns whether the simulated controller answers on its control port."""
    command = ["fling", "sim", "--cell", os.environ["FLING_DEFAULT_CELL"], "state"]
    return subprocess.run(command, stdout=subprocess.DEVNULL, timeout=TIMEOUT_S, check=False).returncode == 0


CHECKS = {"service": service, "executor": executor, "simulator": simulator}

if __name__ == "__main__":
    sys.exit(0 if CHECKS[sys.argv[1]]() else 1)
