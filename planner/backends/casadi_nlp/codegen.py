"""The blocks' functions as machine code: C written by casadi, compiled once, kept in the user's cache folder.

The file's name is the hash of the modules that hold the formulas and of the compiler's options, so a changed formula is
another file and an old one is never used. Nothing is compiled while a request waits: where there is no file, the
interpreted functions serve.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import casadi as ca

from planner.backends.casadi_nlp import blocks

FLAGS = ("-O1", "-fno-math-errno", "-shared", "-fPIC")
FORMULAS = ("arm", "blocks", "clearance", "layout", "stages", "throw")  # modules that the C comes from
COMPILERS = ("cc", "gcc", "clang")


def cache_folder() -> Path:
    """Returns the folder of the compiled functions, under XDG_CACHE_HOME or ~/.cache."""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "fling" / "solvers"


def c_source() -> str:
    """Returns the C of all blocks."""
    generator = ca.CodeGenerator("fling_blocks", {"with_header": False})
    for block in blocks.interpreted().values():
        for function in block.functions:
            generator.add(function)
    return generator.dump()


@cache
def library() -> Path:
    """Returns where the compiled functions are, or would be; told by the formulas' text alone, which is quick."""
    digest = hashlib.sha256(f"{ca.CasadiMeta.version()} {platform.machine()} {FLAGS}".encode())
    for module in sorted(Path(__file__).parent.glob("*.py")):
        if module.stem in FORMULAS:
            digest.update(module.read_bytes())
    return cache_folder() / f"blocks-{digest.hexdigest()[:24]}.so"


def compile_blocks() -> Path | None:
    """Compiles where that has not been done, and returns the library; None where there is no compiler.

    Raises:
        OSError: the cache folder cannot be written.
        subprocess.CalledProcessError: the compiler refuses the C.
    """
    target = library()
    compiler = next((path for name in COMPILERS if (path := shutil.which(name))), None)
    if target.exists() or compiler is None:
        return target if target.exists() else None
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        source, made = Path(folder) / "blocks.c", Path(folder) / "blocks.so"
        source.write_text(c_source())
        subprocess.run([compiler, *FLAGS, "-o", str(made), str(source), "-lm"], check=True, capture_output=True)
        made.replace(target)
    return target


def compiled() -> dict[str, blocks.Block] | None:
    """Returns the blocks with compiled functions, None where they have not been compiled."""
    if not library().exists():
        return None
    path = str(library())
    return {
        name: blocks.Block(name, *(ca.external(f"{name}_{kind}", path) for kind in blocks.KINDS))
        for name in blocks.SOURCES
    }
