"""Bearer tokens: random, stored as SHA-256, compared in constant time, read again when their file changes.

The tokens file is TOML with one table per token: `[[token]] name = "…" sha256 = "…" scopes = ["plan", "operate"]`, and
`expires_at = 2027-01-01T00:00:00Z` for one that ends. A token is revoked by taking its table out. A token has 256
random bits and cannot be guessed, so a plain hash is enough.
"""

from __future__ import annotations

import hashlib
import hmac
import logging
import os
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from planner.documents import parse_toml, read_file
from planner.errors import FileRefused

TOKENS_BYTES = 1_000_000  # [byte] of the tokens file: some thousand tokens
SCOPES = ("plan", "operate")
TOKEN_BYTES = 32
NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,63}")

log = logging.getLogger("fling")


@dataclass(frozen=True)
class Caller:
    """Name and scopes of the client behind a request."""

    name: str
    scopes: frozenset[str]


@dataclass(frozen=True)
class StoredToken:
    """One entry of the tokens file; `expires_at` has a time zone, None: it does not end."""

    caller: Caller
    sha256: str
    expires_at: datetime | None = None

    @property
    def has_expired(self) -> bool:
        """Whether its time is over."""
        return self.expires_at is not None and datetime.now(UTC) >= self.expires_at


class TokenRegistry:
    """The tokens in force: those of a file, read again once it has changed or `reload` was called.

    A file that cannot be read any more leaves the tokens of before in force, and says so in the log: a slip in it must
    not keep anybody from stopping an arm.

    Args:
        path: the tokens file; None: the service asks for no tokens.

    Raises:
        ValueError: The file is missing, wrong, or names no token.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._tokens = () if path is None else read_tokens(path)
        if path is not None and not self._tokens:
            raise ValueError(f"the tokens file {path} names no token: create one with 'fling token create'")
        self._seen = self._stamp()

    @property
    def is_guarded(self) -> bool:
        """Whether the service asks for tokens."""
        return self._path is not None

    def reload(self) -> None:
        """Makes the next request read the file again."""
        self._seen = None

    def find(self, token: str) -> StoredToken | None:
        """Returns the entry of a token, expired or not; None if there is none."""
        if self._path is not None and self._seen != (stamp := self._stamp()):
            self._seen = stamp
            self._read_again(self._path)
        return find_token(self._tokens, token)

    def is_in_force(self, token: str) -> bool:
        """Returns whether a token is known and has not expired."""
        found = self.find(token)
        return found is not None and not found.has_expired

    def _read_again(self, path: Path) -> None:
        try:
            self._tokens = read_tokens(path)
        except ValueError as error:
            log.error("%s; the tokens of before stay in force", error)
        else:
            log.info("read %d tokens from %s", len(self._tokens), path)

    def _stamp(self) -> tuple[int, int, int] | tuple[()] | None:
        """Returns what changes with the file; None without one, () if it is missing."""
        if self._path is None:
            return None
        try:
            status = self._path.stat()
        except OSError:
            return ()
        return status.st_mtime_ns, status.st_size, status.st_ino


def read_tokens(path: Path) -> tuple[StoredToken, ...]:
    """Returns the tokens of a file.

    Raises:
        ValueError: The file is missing or not TOML, or an entry is invalid.
    """
    try:
        document = parse_toml(read_file(path, TOKENS_BYTES))
        return tuple(_stored(entry) for entry in document.get("token", []))
    except KeyError as error:
        raise ValueError(f"the tokens file {path} cannot be read: a token has no {error.args[0]!r}") from error
    except (FileRefused, ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"the tokens file {path} cannot be read: {error}") from error


def _stored(entry: dict[str, object]) -> StoredToken:
    name = entry["name"]
    digest = entry["sha256"]
    scopes = entry["scopes"]
    ends = entry.get("expires_at")
    if not isinstance(digest, str) or not re.fullmatch(r"[0-9a-f]{64}", digest):
        raise ValueError(f"the token {name!r} has no SHA-256")
    if not isinstance(scopes, list) or not set(scopes) <= set(SCOPES):
        raise ValueError(f"the token {name!r} has scopes other than {', '.join(SCOPES)}")
    if ends is not None and (not isinstance(ends, datetime) or ends.tzinfo is None):
        raise ValueError(f"the token {name!r} expires at no instant: write it like 2027-01-01T00:00:00Z")
    return StoredToken(Caller(str(name), frozenset(scopes)), digest, ends)


def find_token(tokens: Sequence[StoredToken], token: str) -> StoredToken | None:
    """Returns the entry of a token, or None. Compares with every stored token, each in constant time."""
    digest = hashlib.sha256(token.encode()).hexdigest()
    found = None
    for stored in tokens:
        if hmac.compare_digest(stored.sha256, digest):
            found = stored
    return found


def create_token(path: Path, name: str, scopes: tuple[str, ...], expires_at: datetime | None = None) -> str:
    """Creates a token, appends its hash to the file (mode 0600), and returns the token itself.

    Raises:
        ValueError: The name is invalid or taken.
    """
    if not NAME_PATTERN.fullmatch(name):
        raise ValueError("a token's name has at most 64 characters: letters, digits and . _ @ -")
    if path.exists() and any(stored.caller.name == name for stored in read_tokens(path)):
        raise ValueError(f"a token named {name!r} exists already")
    token = secrets.token_urlsafe(TOKEN_BYTES)
    stored = StoredToken(Caller(name, frozenset(scopes)), hashlib.sha256(token.encode()).hexdigest(), expires_at)
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    with os.fdopen(descriptor, "a") as file:
        file.write(_entry_text(stored))
    return token


def revoke_token(path: Path, name: str) -> None:
    """Takes a token out of the file; comments in the file go with it.

    Raises:
        ValueError: There is none of this name, or the file cannot be read.
    """
    before = read_tokens(path)
    left = [stored for stored in before if stored.caller.name != name]
    if len(left) == len(before):
        raise ValueError(f"{path} has no token named {name!r}")
    part = path.with_name(f"{path.name}.part")
    descriptor = os.open(part, os.O_WRONLY | os.O_TRUNC | os.O_CREAT, 0o600)
    with os.fdopen(descriptor, "w") as file:
        file.write("".join(map(_entry_text, left)))
    part.replace(path)


def _entry_text(stored: StoredToken) -> str:
    listed = ", ".join(f'"{scope}"' for scope in SCOPES if scope in stored.caller.scopes)
    ends = "" if stored.expires_at is None else f"expires_at = {stored.expires_at.isoformat()}\n"
    return f'[[token]]\nname = "{stored.caller.name}"\nsha256 = "{stored.sha256}"\nscopes = [{listed}]\n{ends}\n'
