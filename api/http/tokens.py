"""Bearer tokens: random, stored as SHA-256, compared in constant time.

The tokens file is TOML with one table per token: `[[token]] name = "…" sha256 = "…" scopes = ["plan", "operate"]`.
A token has 256 random bits and cannot be guessed, so a plain hash is enough.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import secrets
import tomllib
from dataclasses import dataclass
from pathlib import Path

SCOPES = ("plan", "operate")
TOKEN_BYTES = 32
NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}")


@dataclass(frozen=True)
class Caller:
    """Name and scopes of the client behind a request."""

    name: str
    scopes: frozenset[str]


@dataclass(frozen=True)
class StoredToken:
    """One entry of the tokens file."""

    caller: Caller
    sha256: str


def read_tokens(path: Path | None) -> tuple[StoredToken, ...]:
    """Returns the tokens of a file; none without a file.

    Raises:
        ValueError: The file is missing or not TOML, or an entry is invalid.
    """
    if path is None:
        return ()
    try:
        entries = tomllib.loads(path.read_text()).get("token", [])
        return tuple(_stored(entry) for entry in entries)
    except (OSError, tomllib.TOMLDecodeError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"the tokens file {path} cannot be read: {error}") from error


def _stored(entry: dict[str, object]) -> StoredToken:
    name, digest, scopes = entry["name"], entry["sha256"], entry["scopes"]
    if not isinstance(digest, str) or not re.fullmatch(r"[0-9a-f]{64}", digest):
        raise ValueError(f"the token {name!r} has no SHA-256")
    if not isinstance(scopes, list) or not set(scopes) <= set(SCOPES):
        raise ValueError(f"the token {name!r} has scopes other than {', '.join(SCOPES)}")
    return StoredToken(Caller(str(name), frozenset(scopes)), digest)


def find_caller(tokens: tuple[StoredToken, ...], token: str) -> Caller | None:
    """Returns the owner of a token, or None. Compares with every stored token, each in constant time."""
    digest = hashlib.sha256(token.encode()).hexdigest()
    found = None
    for stored in tokens:
        if hmac.compare_digest(stored.sha256, digest):
            found = stored.caller
    return found


def create_token(path: Path, name: str, scopes: tuple[str, ...]) -> str:
    """Creates a token, appends its hash to the file (mode 0600), and returns the token itself.

    Raises:
        ValueError: The name is invalid or taken.
    """
    if not NAME_PATTERN.fullmatch(name):
        raise ValueError("a token's name has at most 64 characters: letters, digits and . _ @ -")
    if path.exists() and any(stored.caller.name == name for stored in read_tokens(path)):
        raise ValueError(f"a token named {name!r} exists already")
    token = secrets.token_urlsafe(TOKEN_BYTES)
    digest = hashlib.sha256(token.encode()).hexdigest()
    listed = ", ".join(f'"{scope}"' for scope in scopes)
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    with os.fdopen(descriptor, "a") as file:
        file.write(f'[[token]]\nname = "{name}"\nsha256 = "{digest}"\nscopes = [{listed}]\n\n')
    return token
