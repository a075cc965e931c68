"""Bearer tokens: made at random, stored as SHA-256, compared in constant time.

The tokens file is TOML, one table a token: ``[[token]] name = "…" sha256 = "…" scopes = ["plan", "operate"]``.
A token has 256 random bits, so a plain hash is enough: there is nothing to guess.
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
class Client:
    """Who is asking, and what they may do."""

    name: str
    scopes: frozenset[str]


@dataclass(frozen=True)
class StoredToken:
    """One line of the tokens file."""

    client: Client
    sha256: str


def read_tokens(path: Path | None) -> tuple[StoredToken, ...]:
    """Returns the tokens of a file; none where there is no file named.

    Raises:
        ValueError: the file is missing, is not TOML, or an entry is wrong.
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
    return StoredToken(Client(str(name), frozenset(scopes)), digest)


def find_client(tokens: tuple[StoredToken, ...], token: str) -> Client | None:
    """Returns whose token it is. Looks at every stored one, each in constant time."""
    digest = hashlib.sha256(token.encode()).hexdigest()
    found = None
    for stored in tokens:
        if hmac.compare_digest(stored.sha256, digest):
            found = stored.client
    return found


def create_token(path: Path, name: str, scopes: tuple[str, ...]) -> str:
    """Makes a token, appends its hash to the file (readable by its owner alone), and returns the token itself.

    Raises:
        ValueError: the name is not fit, or taken.
    """
    if not NAME_PATTERN.fullmatch(name):
        raise ValueError("a token's name has letters, digits and . _ @ - only, 64 at most")
    if path.exists() and any(stored.client.name == name for stored in read_tokens(path)):
        raise ValueError(f"there is a token named {name!r} already")
    token = secrets.token_urlsafe(TOKEN_BYTES)
    digest = hashlib.sha256(token.encode()).hexdigest()
    listed = ", ".join(f'"{scope}"' for scope in scopes)
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    with os.fdopen(descriptor, "a") as file:
        file.write(f'[[token]]\nname = "{name}"\nsha256 = "{digest}"\nscopes = [{listed}]\n\n')
    return token
