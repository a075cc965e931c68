"""What large requests needed goes back to the machine, also where small objects stand beside it."""

from __future__ import annotations

import subprocess
import sys

import pytest

KEPT_MB = 5.0  # [MB] of 60 that were in use
SCRIPT = """
import ctypes, sys, threading
from pathlib import Path
from api.app import serve
from api.settings import ServiceSettings

assert serve(ServiceSettings(database_url="sqlite:////dev/null/none", cells=Path("cells"))) == 1


class Account(ctypes.Structure):  # source: mallinfo(3)
    names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = [(name, ctypes.c_size_t) for name in names.split()]


libc = ctypes.CDLL(None)
libc.mallinfo2.restype = Account
small = []


def read_bodies():
    for _ in range(10):
        bodies = []
        for _ in range(20):
            bodies.append(bytearray(900_000))
            small.append(bytearray(1000))  # what lives on
        bodies.clear()


bytearray(1 << 20)  # the first large one
threads = [threading.Thread(target=read_bodies) for _ in range(3)]
for thread in threads:
    thread.start()
    thread.join()
print(libc.mallinfo2().fordblks / 1e6)
"""


@pytest.mark.slow
def test_bodies_leave_nothing_behind() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert float(done.stdout) < KEPT_MB, done.stderr
