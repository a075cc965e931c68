"""Documents of other people: kind, size, depth and time of reading bounded, each refusal one sentence."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path

import pytest

from planner.documents import (
    DEPTH_MAX,
    ERRORS_MAX,
    KEYS_MAX,
    NotToml,
    is_deeper,
    parse_json,
    parse_toml,
    read_file,
    read_text,
)
from planner.errors import FileRefused, InvalidProblem


def reasons(text: bytes) -> list[tuple[str, str]]:
    with pytest.raises(InvalidProblem) as caught:
        parse_json(text)
    return [(error.field, error.reason) for error in caught.value.errors]


@pytest.mark.parametrize("document", [None, 1, "text", [], {}, {"a": [1, 2.5, True, None, "\u00e4"]}, [[[[]]]]])
def test_json_is_read(document: object):
    assert parse_json(json.dumps(document).encode()) == document


NO_JSON = [
    (b"", "is not JSON at character 1: expecting value"),
    (b'{"release": ', "is not JSON at character 13: expecting value"),
    (b"[1,]", "is not JSON at character 4"),
    ("{}".encode("utf-16"), "is not UTF-8"),
    (b'"\xed\xa0\x80"', "is not UTF-8"),  # half a surrogate pair
    (b"\xe4", "is not UTF-8"),
    (b"1" * 6000, "has a number of more than 4300 digits"),
    (b"[" * 400_000, "nests deeper than 32 levels"),
    (b"[" * 940 + b"]" * 940, "nests deeper than 32 levels"),
    (b'{"a":' * 5000 + b"1" + b"}" * 5000, "nests deeper than 32 levels"),
    (b"[" * (DEPTH_MAX + 1) + b"]" * (DEPTH_MAX + 1), "nests deeper than 32 levels"),
]


@pytest.mark.parametrize(("text", "reason"), NO_JSON, ids=range(len(NO_JSON)))
def test_what_is_no_json_is_refused_in_a_sentence(text: bytes, reason: str):
    ((field, said),) = reasons(text)
    assert field == "body"
    assert said.startswith(reason)


def test_json_may_nest_as_deep_as_the_bound():
    text = b"[" * DEPTH_MAX + b"]" * DEPTH_MAX
    assert json.dumps(parse_json(text)).encode() == text
    assert not is_deeper(json.loads(text), DEPTH_MAX)
    assert is_deeper(json.loads(text), DEPTH_MAX - 1)


def test_a_key_that_is_given_twice_is_named():
    assert reasons(b'{"a": 1, "b": {"c": 1, "c": 2}, "a": 3}') == [("c", "is given twice"), ("a", "is given twice")]


def test_an_object_has_a_bounded_number_of_fields():
    assert len(parse_json(json.dumps({f"k{i}": i for i in range(KEYS_MAX)}).encode())) == KEYS_MAX
    text = json.dumps({"start": {f"k{i}": i for i in range(90_000)}}).encode()
    assert reasons(text) == [("k0", "there are 90000 fields in one object; there may be 100")]


MANY = {
    "keys twice": b"{" + b",".join(b'"a":1' for _ in range(100_000)) + b"}",
    "objects": b"[" + b",".join(b"{" + b",".join(b'"%d":1' % i for i in range(101)) + b"}" for _ in range(900)) + b"]",
    "no text": json.dumps(["\ud800"] * 60_000).encode(),
    "keys of no text": json.dumps([{"\0": 1}] * 60_000).encode(),
}


@pytest.mark.parametrize("text", MANY.values(), ids=MANY)
def test_the_first_faults_are_named(text: bytes):
    assert len(reasons(text)) == ERRORS_MAX


def test_a_text_that_a_database_cannot_hold_is_named_by_its_path():
    document = {"a": [{"b": "good"}, {"b": "\0"}, {"\ud800": 1}], "c": "\udfff"}
    said = reasons(json.dumps(document).encode())
    assert said == [(field, "has a character that is no text") for field in ("a[1].b", "a[2].'\\ud800'", "c")]


def test_long_names_are_cut():
    key = "k" * 500_000
    ((field, _),) = reasons(json.dumps({key: "\0"}).encode())
    assert field == f"{80 * 'k'}…"


# Files


def test_a_file_is_read_up_to_its_bound(tmp_path: Path):
    file = tmp_path / "file"
    file.write_bytes(b"1234")
    assert read_file(file, 4) == b"1234"
    with pytest.raises(FileRefused, match=f"{file}: is larger than 3 bytes"):
        read_file(file, 3)


def test_text_is_utf_8(tmp_path: Path):
    file = tmp_path / "file"
    file.write_text("ä", encoding="latin-1")
    with pytest.raises(FileRefused, match="is not UTF-8"):
        read_text(file, 100)


def test_what_is_no_file_is_named_at_once(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    kinds = {tmp_path: "is a folder", tmp_path / "pipe": "is a pipe", Path("/dev/zero"): "is a device"}
    for path, reason in kinds.items():
        with pytest.raises(FileRefused, match=reason):
            read_file(path, 100)
    for name in ("socket", "loop", "absent", "n" * 300, "nul\0"):
        with pytest.raises(FileRefused):
            read_file(tmp_path / name, 100)


# TOML


def test_toml_is_read():
    assert parse_toml(b'a.b = 1\n[[c]]\nd = "a.b.c"') == {"a": {"b": 1}, "c": [{"d": "a.b.c"}]}


NO_TOML = [
    (b"a = ", "is not TOML"),
    (b"\xff", "is not TOML"),
    (b"a = " + b"1" * 6000, "is not TOML: Exceeds the limit"),
    (b"a = " + b"[" * 5000 + b"]" * 5000, "nests deeper than 32 levels"),
    (b"a = " + b"{a=" * 5000 + b"1" + b"}" * 5000, "nests deeper than 32 levels"),
    (b"a = " + b"[" * 33 + b"]" * 33, "nests deeper than 32 levels"),
    (b"a" + b".a" * 100_000 + b" = 1", "nests deeper than 32 levels"),
    (b"[a" + b' . "b"' * 30_000 + b"]", "nests deeper than 32 levels"),
    (b"a = {" + b"'a'." * 50_000 + b"b = 1}", "nests deeper than 32 levels"),
]


@pytest.mark.parametrize(("text", "reason"), NO_TOML, ids=range(len(NO_TOML)))
def test_what_is_no_toml_is_refused_in_a_sentence(text: bytes, reason: str):
    with pytest.raises(NotToml) as caught:
        parse_toml(text)
    assert str(caught.value).startswith(reason)
