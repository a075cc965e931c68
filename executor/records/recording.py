"""The recording of a run, one row a tick: planned and measured motion, as samples and as MCAP.

The MCAP holds JSON messages under Foxglove's schema names; its panels show joints and log without a plug-in.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import orjson
from mcap.writer import CompressionType, Writer

from executor.records.telemetry import Telemetry, column_names
from executor.shared_memory import SCALARS, VECTORS
from store import pack_samples

NANOSECONDS = 1_000_000_000
NUMBER = {"type": "number"}
INTEGER = {"type": "integer"}
TEXT = {"type": "string"}
COUNTS = ("safety_bits", "runtime_state", "digital_outputs", "digital_inputs", "missed_ticks")  # whole numbers
TIME = {"type": "object", "properties": {"sec": INTEGER, "nsec": INTEGER}}
JOINT = {"type": "object", "properties": {"name": TEXT, "position": NUMBER, "velocity": NUMBER, "effort": NUMBER}}
JOINT_STATES = "foxglove.JointStates"
TICK = "fling.Tick"
LOG = "foxglove.Log"  # names of the schemas
SCHEMAS: dict[str, dict[str, Any]] = {
    JOINT_STATES: {"timestamp": TIME, "joints": {"type": "array", "items": JOINT}},
    LOG: {"timestamp": TIME, "level": INTEGER, "message": TEXT, "name": TEXT, "file": TEXT, "line": INTEGER},
    TICK: {
        "timestamp": TIME,
        "command": {"type": "array", "items": NUMBER},
        **{name: INTEGER if name in COUNTS else NUMBER for name in SCALARS},
    },
}
TOPICS = {"/planned": JOINT_STATES, "/measured": JOINT_STATES, "/tick": TICK, "/log": LOG}
LOG_INFO = 2  # source: foxglove.Log, levels
Events = Sequence[tuple[float, str]]  # of an execution: time [s since the epoch], text


def to_samples(telemetry: Telemetry) -> bytes:
    """Returns the rows as samples; the store makes CSV of them."""
    return pack_samples(column_names(), telemetry.rows)


def to_mcap(
    telemetry: Telemetry, joints: Sequence[str], started_at: float, log: Events, about: Mapping[str, str]
) -> bytes:
    """Returns the rows as MCAP.

    Args:
        telemetry: the rows.
        joints: names of the joints.
        started_at: time of the first row [s since the epoch].
        log: events of the execution.
        about: metadata: execution, plan, cell and its hash, outcome.
    """
    stream = io.BytesIO()
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start(profile="", library="fling")
    channels = _channels(writer)
    writer.add_metadata("fling", dict(about))
    messages = [*_ticks(telemetry, joints, started_at), *_log(log)]
    for order, (at, topic, message) in enumerate(sorted(messages, key=lambda m: m[0])):
        message["timestamp"] = {"sec": at // NANOSECONDS, "nsec": at % NANOSECONDS}
        writer.add_message(channels[topic], log_time=at, publish_time=at, sequence=order, data=orjson.dumps(message))
    writer.finish()
    return stream.getvalue()


def _channels(writer: Writer) -> dict[str, int]:
    schemas = {
        name: writer.register_schema(
            name=name, encoding="jsonschema", data=orjson.dumps({"type": "object", "title": name, "properties": fields})
        )
        for name, fields in SCHEMAS.items()
    }
    return {
        topic: writer.register_channel(topic=topic, message_encoding="json", schema_id=schemas[schema])
        for topic, schema in TOPICS.items()
    }


def _ticks(telemetry: Telemetry, joints: Sequence[str], started_at: float) -> Iterator[tuple[int, str, dict[str, Any]]]:
    if not len(telemetry):
        return
    columns = {name: telemetry.scalar(name).tolist() for name in SCALARS}
    vectors = {name: telemetry.vector(name).tolist() for name in VECTORS}
    for i, stamp in enumerate(columns["timestamp_s"]):
        at = round((started_at + stamp - columns["timestamp_s"][0]) * NANOSECONDS)
        tick = {name: int(values[i]) if name in COUNTS else values[i] for name, values in columns.items()}
        yield at, "/tick", {"command": vectors["command"][i], **tick}
        yield at, "/planned", _joints(joints, vectors["planned_q"][i], vectors["planned_qd"][i], None)
        yield at, "/measured", _joints(joints, vectors["q"][i], vectors["qd"][i], vectors["current"][i])


def _joints(names: Sequence[str], q: list[float], qd: list[float], current: list[float] | None) -> dict[str, Any]:
    efforts = current or [0.0] * len(names)
    rows = zip(names, q, qd, efforts, strict=True)
    return {"joints": [{"name": n, "position": x, "velocity": v, "effort": e} for n, x, v, e in rows]}


def _log(log: Events) -> Iterator[tuple[int, str, dict[str, Any]]]:
    for at, text in log:
        message = {"level": LOG_INFO, "message": text, "name": "executor", "file": "", "line": 0}
        yield round(at * NANOSECONDS), "/log", message
