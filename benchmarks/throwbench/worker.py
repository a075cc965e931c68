"""The process of an entry that is a function: it loads the function and answers one problem after another.

Run as a file, so that nothing of Fling is loaded with it: `worker.py DESCRIPTOR module:function`.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

Function = Callable[[dict[str, Any]], Any]


def serve(connection: Connection[Any, Any], place: str) -> None:
    """Answers problems from `connection` until it closes; whatever the function raises ends the process.

    The first message says that the function is loaded. Each answer is a pair: JSON text, and the processor time [s].

    Args:
        connection: To the benchmark.
        place: "module:function" or "file.py:function".
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # solvers print banners
    function = load(place)
    connection.send("loaded")
    while True:
        try:
            problem = json.loads(connection.recv())
        except EOFError:
            return
        before = _processor_s()
        text = json.dumps(function(problem), default=_plain)
        connection.send((text, _processor_s() - before))


def load(place: str) -> Function:
    """Returns the function of "module:function" or "file.py:function"; a file finds the modules beside it."""
    module_name, _, function = place.rpartition(":")
    if not module_name.endswith(".py"):
        sys.path.insert(0, os.getcwd())
        return getattr(importlib.import_module(module_name), function)
    file = Path(module_name).resolve()
    sys.path.insert(0, str(file.parent))
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file} is not a Python module")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, function)


def _plain(value: Any) -> Any:
    """Returns what JSON knows of an array or a number of numpy."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not of JSON")


def _processor_s() -> float:
    return sum(os.times()[:4])


if __name__ == "__main__":
    sys.path.pop(0)  # this folder
    serve(Connection(int(sys.argv[1])), sys.argv[2])
