"""Entry of the streaming process: `python -m executor.streaming CHANNEL_FD PARENT_PID`."""

from __future__ import annotations

import fcntl
import os
import signal
import socket
import sys
import traceback
from contextlib import suppress
from dataclasses import replace
from time import monotonic

from executor import realtime
from executor import shared_memory as shm
from executor.stream_job import OUTCOMES, StreamJob
from executor.stream_order import StreamOrder
from executor.streaming.approach import approach, take_object
from executor.streaming.rtde_connection import RtdeConnection
from executor.streaming.script_stream import stream_of
from executor.streaming.start import await_start, first_row_s
from executor.streaming.state_checks import StopRequests, StreamFault


def run(
    job: StreamJob, memory: shm.SharedMemory, requests: StopRequests, connections: list[RtdeConnection]
) -> tuple[str, str]:
    """Runs one job from connecting to rest; returns outcome and reason.

    Args:
        job: what to stream.
        memory: shared with the daemon.
        requests: reasons to stop early.
        connections: receives the connection and keeps it alive: a destructor of the library sleeps half a second.

    Raises:
        StreamFault: nothing was sent after the first anomaly; the controller's watchdog and the daemon stop the arm.
    """
    if (early := requests.pending()) is not None:
        return early
    refused = realtime.prepare_stream(job.core, job.priority)
    memory.fields[shm.REALTIME] = 0.0 if refused else 1.0
    connection = RtdeConnection(job, memory)
    connections.append(connection)
    realtime.step_down(job.priority)
    realtime.freeze_memory()
    connection.check()
    verdict = requests.pending()
    if verdict is None:
        memory.fields[shm.STATE] = memory.fields[shm.FURTHEST] = shm.APPROACHING
        verdict = take_object(connection, requests)
    if verdict is None:
        connection.arm_watchdog()  # before the first motion: the arm moves only while this process keeps it moving
        verdict = approach(connection, requests)
    if verdict is None:
        memory.fields[shm.READY_AT_S] = monotonic()
        job, verdict = await_start(connection, job, requests)
    if verdict is None:
        memory.fields[shm.STATE] = memory.fields[shm.FURTHEST] = shm.STREAMING
        verdict = stream_of(connection, job, requests, first_s=first_row_s(job)).run()
    memory.fields[shm.STATE] = shm.STOPPING
    connection.stop()
    connection.gripper.finish()
    connection.part()
    return verdict


def main(channel_fd: int, parent: int) -> None:
    """Waits for the order, and obeys it; ends with the executor whose process `parent` is."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the daemon, which ends this process
    with suppress(OSError):  # where the disk of its log knows no locks, nobody finds it
        fcntl.lockf(sys.stdout, fcntl.LOCK_EX | fcntl.LOCK_NB)  # by this the next executor finds it
    realtime.terminate_with_parent(parent)
    order = StreamOrder.wait(socket.socket(fileno=channel_fd))
    if order is not None:
        obey(order, parent)


def obey(order: StreamOrder, parent: int) -> None:
    """Runs the job, writes its end to the shared memory and exits at once, past the library's destructors."""
    memory = shm.SharedMemory.attach(order.memory)
    job = replace(StreamJob.read(order.job), gripper_fd=order.gripper)
    connections: list[RtdeConnection] = []
    state = shm.FAULT
    code = 1
    outcome = "executor_lost"
    reason = "the streaming process failed"
    try:
        requests = StopRequests(memory, job.daemon_silent_s, parent, order.pulse)
        requests.listen()
        memory.fields[shm.PULSE] = monotonic()
        outcome, reason = run(job, memory, requests, connections)
        state = shm.DONE
        code = 0
    except StreamFault as fault:
        outcome = fault.outcome
        reason = fault.reason
    except Exception:  # a bug: the finally below leaves the arm to the watchdog and the daemon
        reason = traceback.format_exc(limit=-3)
    finally:
        with suppress(OSError):  # the log, on a full disk: the next daemon reads what this one cannot
            print(f"{outcome}: {reason}", flush=True)
        memory.write_text(reason)
        memory.fields[shm.OUTCOME] = OUTCOMES.index(outcome)
        memory.fields[shm.STATE] = state
        os._exit(code)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
