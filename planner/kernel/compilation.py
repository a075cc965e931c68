"""C compiled for this machine: once, into the user's cache folder, under a name that is the hash of what it depends on.

A changed source gives another file, so a file that exists is never out of date, and several processes, versions and
checkouts share the folder. The file appears by one rename, complete or not at all.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

COMPILERS = ("cc", "gcc", "clang")
SHARED = ("-shared", "-fPIC")  # a library that a running process can load


def cache_folder() -> Path:
    """Returns the folder of compiled libraries, under XDG_CACHE_HOME or ~/.cache."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "fling" / "solvers"


def library_path(name: str, flags: Sequence[str], sources: Iterable[bytes], writer: str = "") -> Path:
    """Returns the path of a library, whether it exists or not.

    Args:
        name: with which the file's name begins.
        flags: of the compiler.
        sources: what the C follows from.
        writer: version of the program that writes the C from them, if one does.
    """
    digest = hashlib.sha256(f"{writer} {platform.machine()} {tuple(flags)}".encode())
    for source in sources:
        digest.update(source)
    return cache_folder() / f"{name}-{digest.hexdigest()[:24]}.so"


def compile_once(
    target: Path, flags: Sequence[str], units: Callable[[], Sequence[str]], linked: Sequence[str] = ()
) -> Path | None:
    """Compiles C into `target` unless it exists, and returns it; None without a compiler.

    Args:
        target: a `library_path`.
        flags: of the compiler, `SHARED` among them.
        units: returns the C in parts, which are compiled side by side; called only where they are.
        linked: arguments of the linker.

    Raises:
        OSError: the cache folder cannot be written.
        subprocess.CalledProcessError: the compiler rejects the C.
    """
    compiler = next((path for name in COMPILERS if (path := shutil.which(name))), None)
    if target.exists() or compiler is None:
        return target if target.exists() else None
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:

        def run(*arguments: str) -> None:
            subprocess.run([compiler, *flags, *arguments], check=True, capture_output=True)

        def compile_unit(c_file: Path) -> None:
            run("-c", "-o", str(c_file.with_suffix(".o")), str(c_file))

        files = []
        for i, text in enumerate(units()):
            files.append(Path(folder) / f"{target.stem}-{i}.c")
            files[i].write_text(text)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(compile_unit, files))
        made = Path(folder) / target.name
        run("-o", str(made), *(str(c_file.with_suffix(".o")) for c_file in files), *linked, "-lm")
        made.replace(target)
    return target
