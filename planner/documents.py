"""Documents that other people wrote, as files or as bodies of requests: kind, size, depth and time of reading bounded.

What is refused is refused in one sentence: `FileRefused` for a file, `InvalidProblem` for JSON, `NotToml` for TOML,
`NotXml` for XML.
"""

from __future__ import annotations

import json
import os
import re
import stat
import sys
import tomllib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from planner.errors import ERRORS_MAX, FieldError, FileRefused, InvalidProblem
from planner.fields import short_name

DEPTH_MAX = 32  # lists and objects within one another; no document of Fling has more than ten
KEYS_MAX = 100  # of one object; no document of Fling has more than thirty
BLOCK_BYTES = 1 << 20  # read at once, so that a file is not read far beyond its bound

KINDS = {  # what is no file, in words
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
NO_TEXT = re.compile("[\0\ud800-\udfff]")  # what PostgreSQL or UTF-8 cannot hold
# A key such as a.b.c of more parts than `DEPTH_MAX`: the parser's time grows with their square.
KEY_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*"""
LONG_KEY = re.compile(f"(?<![A-Za-z0-9_-])(?:{KEY_PART}){{{DEPTH_MAX}}}")


class NotToml(ValueError):
    """A text is no TOML, or nests too deep; the message is the end of a sentence."""


class NotXml(ValueError):
    """A text is no XML, nests too deep or has entities of its own; the message is the end of a sentence."""


def read_file(path: Path | str, most_bytes: int) -> bytes:
    """Returns the content of a regular file; a pipe or a device is refused without waiting for it.

    Args:
        path: of the file.
        most_bytes: its greatest size [byte].

    Raises:
        FileRefused: it is not there, is no file, or is larger.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise FileRefused(path, getattr(error, "strerror", None) or "cannot be opened") from error
    try:
        kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
        if kind != stat.S_IFREG:
            raise FileRefused(path, f"is {KINDS.get(kind, 'something else')}, not a file")
        return _bounded(path, partial(os.read, descriptor), most_bytes)
    finally:
        os.close(descriptor)


def read_standard_input(most_bytes: int) -> bytes:
    """Returns what comes on standard input, up to its end.

    Args:
        most_bytes: greatest size [byte].

    Raises:
        FileRefused: it is more.
    """
    return _bounded("standard input", sys.stdin.buffer.read, most_bytes)


def _bounded(path: Path | str, read: Callable[[int], bytes], most_bytes: int) -> bytes:
    content = bytearray()
    try:
        while block := read(BLOCK_BYTES):
            content += block
            if len(content) > most_bytes:
                raise FileRefused(path, f"is larger than {most_bytes} bytes")
    except OSError as error:
        raise FileRefused(path, error.strerror or "cannot be read") from error
    return bytes(content)


def read_text(path: Path | str, most_bytes: int) -> str:
    """Returns the text of a file in UTF-8.

    Raises:
        FileRefused: see `read_file`; or it is not UTF-8.
    """
    try:
        return read_file(path, most_bytes).decode()
    except UnicodeDecodeError as error:
        raise FileRefused(path, "is not UTF-8") from error


def parse_toml(text: bytes) -> dict[str, Any]:
    """Returns the tables of a TOML document.

    Raises:
        NotToml: it is none, or nests deeper than `DEPTH_MAX`.
    """
    too_deep = f"nests deeper than {DEPTH_MAX} levels"
    try:
        decoded = text.decode()
        if LONG_KEY.search(decoded):
            raise NotToml(too_deep)
        document = tomllib.loads(decoded)
    except RecursionError:
        raise NotToml(too_deep) from None
    except NotToml:
        raise
    except ValueError as error:  # also of integers of thousands of digits, and of what is not UTF-8
        raise NotToml(f"is not TOML: {error}") from error
    if is_deeper(document, DEPTH_MAX):
        raise NotToml(too_deep)
    return document


def toml_text(value: Any) -> str:
    """Returns a text, a number or lists of numbers as TOML writes them; a text as JSON does, which TOML reads alike."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return f"[{', '.join(map(toml_text, value))}]" if isinstance(value, list) else repr(value)


def parse_xml(text: bytes) -> Element:
    """Returns the root of an XML document without entities of its own, which could stand for gigabytes, or for files.

    Raises:
        NotXml: it is none, declares a document type, or nests deeper than `DEPTH_MAX`.
    """
    builder = TreeBuilder()
    depth = 0

    def start(name: str, attributes: Mapping[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEPTH_MAX:
            raise NotXml(f"nests deeper than {DEPTH_MAX} levels")
        builder.start(name, dict(attributes))

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    def refuse(*_: object) -> None:
        raise NotXml("declares a document type: entities are not read")

    parser = expat.ParserCreate()
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except NotXml:
        raise
    except (expat.ExpatError, ValueError, LookupError) as error:  # the latter two: of its encoding
        raise NotXml(f"is not XML: {error}") from error
    return builder.close()


def is_deeper(document: Any, levels: int) -> bool:
    """Returns whether lists and mappings are within one another more than so many times."""
    level = [document]
    for _ in range(levels):
        level = [entry for value in level for entry in _entries(value)]
        if not level:
            return False
    return any(isinstance(value, dict | list) for value in level)


def _entries(value: Any) -> Any:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def parse_json(text: bytes) -> Any:
    """Returns a JSON document that means one thing, in numbers and texts that a database and an answer can hold.

    Raises:
        InvalidProblem: it is no JSON, has a key twice in an object or more than `KEYS_MAX` keys, nests deeper than
            `DEPTH_MAX`, or has text that is not Unicode or has a NUL.
    """
    errors: list[FieldError] = []
    document = _read_json(text, partial(_object, errors))
    if is_deeper(document, DEPTH_MAX):
        raise _too_deep()
    errors += [FieldError(field, "has a character that is no text") for field in _unprintable(document)]
    if errors:
        raise InvalidProblem(errors)
    return document


def _read_json(text: bytes, made: Callable[[list[tuple[str, Any]]], dict[str, Any]]) -> Any:
    """Returns a document; `made` makes an object of its members."""
    try:
        return json.loads(text.decode("utf-8-sig"), object_pairs_hook=made)
    except json.JSONDecodeError as error:
        raise _not_json(f"is not JSON at character {error.pos + 1}: {error.msg.lower()}") from None
    except RecursionError:
        raise _too_deep() from None
    except UnicodeDecodeError:
        raise _not_json("is not UTF-8") from None
    except ValueError:
        raise _not_json(f"has a number of more than {sys.get_int_max_str_digits()} digits") from None


def _object(errors: list[FieldError], pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Returns the object of these members; adds what is wrong with them."""
    found = dict(pairs)
    if len(found) < len(pairs):
        _note_twice(pairs, errors)
    if len(found) > KEYS_MAX and len(errors) < ERRORS_MAX:
        reason = f"there are {len(found)} fields in one object; there may be {KEYS_MAX}"
        errors.append(FieldError(_shown(next(iter(found))), reason))
    return found


def _note_twice(pairs: list[tuple[str, Any]], errors: list[FieldError]) -> None:
    seen: set[str] = set()
    for key, _ in pairs:
        if len(errors) == ERRORS_MAX:
            return
        if key in seen:
            errors.append(FieldError(_shown(key), "is given twice"))
        seen.add(key)


def _not_json(reason: str) -> InvalidProblem:
    return InvalidProblem([FieldError("body", reason)])


def _too_deep() -> InvalidProblem:
    return _not_json(f"nests deeper than {DEPTH_MAX} levels")


def _unprintable(document: Any) -> list[str]:
    """Returns the paths of keys and values with a NUL or half a surrogate pair, which PostgreSQL and UTF-8 refuse.

    Paths are kept as chains of their parts, and written for what is found alone: a document of a megabyte can have
    paths of many gigabytes.
    """
    found: list[str] = []
    left: list[tuple[Any, Any]] = [(document, None)]
    while left and len(found) < ERRORS_MAX:
        value, place = left.pop()
        if isinstance(value, str):
            if not _is_text(value):
                found.append(_path(place))
        elif isinstance(value, dict):
            left.extend((entry, (place, key)) for key, entry in reversed(value.items()))
            found.extend(_path((place, key)) for key in value if not _is_text(key))
        elif isinstance(value, list):
            left.extend((value[i], (place, i)) for i in range(len(value) - 1, -1, -1))
    return found


def _path(place: Any) -> str:
    """Returns a chain of keys and indices, (((None, "a"), 2), "b"), as `a[2].b`."""
    parts: list[str] = []
    while place is not None:
        place, part = place
        parts.append(f"[{part}]" if isinstance(part, int) else f".{_shown(part)}")
    return "".join(reversed(parts)).removeprefix(".") or "body"


def _is_text(value: str) -> bool:
    return NO_TEXT.search(value) is None


def _shown(key: str) -> str:
    return short_name(key if _is_text(key) else ascii(key))
