"""The record of an audit on disk: a line that says of what, and a line a problem. A kill loses what was in work."""

from __future__ import annotations

import fcntl
import hashlib
import json
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

from audit.problems import GENERATOR
from audit.trial import Trial
from fling import __version__

ROOT = Path(__file__).parents[1]
ROWS = "audit.jsonl"
SUMMARY = "summary.json"
CODE = ("planner", "verifier", "audit")  # packages whose code decides about the results
SUFFIXES = (".py", ".toml", ".yaml", ".so")
PACKAGES = ("numpy", "casadi", "ruckig", "pin", "coal", "mujoco", "scipy", "trimesh")
SIGNED = ("index", "kind", "arm", "outcome", "plan_sha256", "faults", "proof")  # of a row: what does not take its time


class RecordRefused(Exception):
    """A record cannot be begun or continued; the message says why."""


def signature(seed: int, proofs: float) -> dict[str, Any]:
    """Returns what a record is of: seed, share of proofs, and everything that decides about its results."""
    return {
        "audit": "fling",
        "version": __version__,
        "commit": _commit(),
        "code_sha256": _code_sha256(),
        "generator": GENERATOR,
        "seed": seed,
        "proofs": proofs,
        "packages": {name: _version(name) for name in PACKAGES},
    }


class AuditRecord:
    """The rows of an audit in a folder.

    Args:
        folder: is made where there is none.
        about: `signature` of the audit.
        resume: whether to continue what is there.

    Attributes:
        rows: by index.

    Raises:
        RecordRefused: there is a record already, one of another signature, or something else; another audit writes it.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any], resume: bool) -> None:
        self.about = about
        self.rows: dict[int, dict[str, Any]] = {}
        self._folder = folder
        self._path = folder / ROWS
        folder.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("a", encoding="utf-8")
        try:
            self._begin(resume)
        except RecordRefused:
            self.close()
            raise

    def __enter__(self) -> Self:
        """Returns itself; it is closed at the end of the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes the file."""
        self.close()

    def close(self) -> None:
        """Closes the file, so that another audit may go on with it."""
        self._file.close()

    def _begin(self, resume: bool) -> None:
        """Takes the file for this audit alone, and reads what is there.

        Raises:
            RecordRefused: as of the constructor.
        """
        try:
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise RecordRefused(f"{self._path} is being written by another audit") from error
        if not self._path.stat().st_size:
            self._append(self.about)
        elif resume:
            self._continue()
        else:
            raise RecordRefused(f"{self._path} is a record already: give --resume, or another --out")

    def add(self, trial: Trial) -> None:
        """Appends what became of a problem."""
        row = json.loads(json.dumps(trial.as_row()))
        self._append(row)
        self.rows[trial.index] = row

    @property
    def size_bytes(self) -> int:
        """Size of the file [byte]."""
        return self._path.stat().st_size

    def end(self, summary: Mapping[str, Any]) -> None:
        """Writes the summary beside the rows."""
        text = json.dumps({**self.about, **summary}, indent=2) + "\n"
        (self._folder / SUMMARY).write_text(text, encoding="utf-8")

    def _continue(self) -> None:
        """Reads the rows that are there, and cuts off a line that a kill has left unfinished.

        Raises:
            RecordRefused: they are of another signature.
        """
        content = self._path.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        if not whole:  # a kill within the first line
            self._file.truncate(0)
            self._append(self.about)
            return
        try:
            lines = [json.loads(line) for line in whole.splitlines()]
            rows = {int(row["index"]): row for row in lines[1:]}
            if len(rows) != len(lines) - 1:
                raise ValueError("an index stands twice")
            header = dict(lines[0])
        except (ValueError, KeyError, IndexError, TypeError) as error:
            raise RecordRefused(f"{self._path} is no record: {error!r}") from error
        for name, value in self.about.items():
            if header.get(name) != value:
                raise RecordRefused(f"{self._path} is of another {name}: {header.get(name)!r}, this one: {value!r}")
        if whole != content:
            with self._path.open("r+b") as file:
                file.truncate(len(whole))
        self.rows = rows

    def _append(self, row: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()


def rows_sha256(rows: Mapping[int, Mapping[str, Any]]) -> str:
    """Returns the hash over rows in the order of their index, without times and margins."""
    digest = hashlib.sha256()
    for index in sorted(rows):
        signed = {name: rows[index].get(name) for name in SIGNED}
        digest.update(json.dumps(signed, sort_keys=True).encode() + b"\n")
    return digest.hexdigest()


def _code_sha256() -> str:
    """Returns the hash over names and contents of the files that decide about the results."""
    digest = hashlib.sha256()
    for package in CODE:
        for file in sorted((ROOT / package).rglob("*")):
            if file.suffix in SUFFIXES and file.is_file():
                digest.update(f"{file.relative_to(ROOT).as_posix()}\0".encode())
                digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _commit() -> str:
    """Returns the commit of a checkout, marked where files differ from it; "unknown" of an installed Fling."""
    if not (ROOT / ".git").exists():
        return "unknown"
    commit = _git("rev-parse", "HEAD")
    return f"{commit}, with changes" if _git("status", "--porcelain", "--untracked-files=no") else commit


def _git(*words: str) -> str:
    try:
        done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
