"""The stop socket of each executor: an operator's stop needs neither the database nor the service.

An executor listens on a Unix socket in its folder, `FLING_DATA/executor/CELL/stop`, which service and command line
find by its name. A message is one JSON object, and so is its answer: the execution that the executor runs, or null.
Whoever may write to the socket may stop the arm, and nothing else.
"""

from __future__ import annotations

import json
import os
import select
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

NAME = "stop"
ANSWER_S = 0.3  # [s] an executor answers within milliseconds, on a busy machine within tens; a frozen one never
MESSAGE_BYTES = 65536  # [byte] far above a row of executions
KIND = socket.SOCK_SEQPACKET  # a message arrives whole or not at all
EVERYONE = 0o666  # stopping needs no permission (docs/decisions/0021-permissions.md)


def executor_folder(data: Path, cell: str) -> Path:
    """Returns the folder of a cell's executor."""
    return data / "executor" / cell


def listen(folder: Path) -> socket.socket:
    """Returns the listening socket of the executor that owns a folder; an earlier one's is replaced.

    Raises:
        OSError: it cannot be made.
    """
    listener = socket.socket(socket.AF_UNIX, KIND)
    try:
        with _short_path(folder) as path:
            part = Path(f"{path}.part")
            part.unlink(missing_ok=True)
            listener.bind(str(part))
            part.chmod(EVERYONE)
            listener.listen()
            part.rename(path)  # whoever finds it is answered
        listener.setblocking(False)
    except OSError:
        listener.close()
        raise
    return listener


def running(data: Path) -> list[dict[str, Any]]:
    """Returns the executions that this machine's executors run, the newest first."""
    runs = [run for run in _answers(data, {"ask": "running"}) if run is not None]
    return sorted(runs, key=lambda run: run["id"], reverse=True)


def is_executor_here(data: Path) -> bool:
    """Returns whether an executor of this machine answers, whatever it does."""
    return bool(_answers(data, {"ask": "running"}))


def stop(data: Path, execution_id: str, who: str) -> dict[str, Any] | None:
    """Asks for the brake of an execution; one that its executor has not begun yet will not begin.

    Args:
        data: folder of the executors' files.
        execution_id: of the execution.
        who: asks.

    Returns:
        The execution as its executor knows it; None where no executor of this machine runs it.
    """
    answers = _answers(data, {"ask": "stop", "execution_id": execution_id, "who": who})
    return next((run for run in answers if run is not None and run["id"] == execution_id), None)


def stop_newest(data: Path, who: str) -> dict[str, Any] | None:
    """Asks for the brake of the newest execution that runs; None where none does."""
    runs = running(data)
    return stop(data, runs[0]["id"], who) if runs else None


def _answers(data: Path, message: Mapping[str, Any]) -> list[dict[str, Any] | None]:
    """Returns what the executors answer, None from one that runs nothing; one that is late is left out."""
    text = json.dumps(message).encode()
    waiting = select.poll()
    asked: dict[int, socket.socket] = {}
    answers: list[dict[str, Any] | None] = []
    with ExitStack() as stack:
        for folder in data.glob(f"executor/*/{NAME}"):
            with suppress(OSError):  # nobody listens any more
                connection = stack.enter_context(socket.socket(socket.AF_UNIX, KIND))
                connection.setblocking(False)
                with _short_path(folder.parent) as path:
                    connection.connect(path)
                connection.send(text)
                asked[connection.fileno()] = connection
                waiting.register(connection, select.POLLIN)
        end = time.monotonic() + ANSWER_S
        while asked and (left_s := end - time.monotonic()) > 0.0:
            for number, _ in waiting.poll(1e3 * left_s):
                waiting.unregister(number)
                with suppress(OSError, ValueError):  # it has just ended
                    answers.append(json.loads(asked.pop(number).recv(MESSAGE_BYTES)))
    return answers


@contextmanager
def _short_path(folder: Path) -> Iterator[str]:
    """Yields a path of the socket in a folder that fits into a socket's address, which has 108 bytes."""
    number = os.open(folder, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{number}/{NAME}"
    finally:
        os.close(number)
