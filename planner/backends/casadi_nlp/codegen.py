"""Machine code of the blocks' functions: C written by casadi, compiled once, kept in the user's cache folder.

The file name is the hash of the modules that hold the formulas and of the compiler's options, so a changed formula
gives another file. Nothing is compiled while a request waits: without a file, the interpreted functions are used.
A wheel carries the C, so that only the compiler has to run.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import casadi as ca

from planner.backends.casadi_nlp.functions import KINDS, Block, interpreted_blocks
from planner.backends.casadi_nlp.symbols import ALL_FORMULAS
from planner.kernel import SHARED, compile_once, library_path

# -O2 takes twice the compile time without a faster solve. Fused operations would round otherwise than the interpreter.
FLAGS = ("-O1", "-fno-math-errno", "-ffp-contract=off", *SHARED)
SHIPPED_C = Path(__file__).with_name("blocks.c")  # in wheels alone: setup.py writes it
SYMBOLS = ("__init__", "arm", "distances", "rows", "terms")
FORMULA_MODULES = ("functions", "layout", *(f"symbols/{name}" for name in SYMBOLS))  # sources of the C


def c_source() -> str:
    """Returns the C of all blocks: the shipped one if it follows from these formulas, or else newly written."""
    with suppress(OSError):
        shipped = SHIPPED_C.read_text()
        if shipped.startswith(_origin()):
            return shipped
    return _origin() + _written_c()


def _origin() -> str:
    """Returns the first line of the C: what it follows from."""
    digest = hashlib.sha256(ca.CasadiMeta.version().encode())
    for source in _formulas():
        digest.update(source)
    return f"/* {digest.hexdigest()} */\n"


def _formulas() -> Iterator[bytes]:
    return (Path(__file__).parent.joinpath(f"{module}.py").read_bytes() for module in FORMULA_MODULES)


def _written_c() -> str:
    generator = ca.CodeGenerator("fling_blocks", {"with_header": False})
    for block in interpreted_blocks().values():
        for function in block.functions:
            generator.add(function)
    return generator.dump()


@cache
def library() -> Path:
    """Returns the path of the compiled functions, whether they exist or not."""
    return library_path("blocks", FLAGS, _formulas(), writer=ca.CasadiMeta.version())


def compile_blocks() -> Path | None:
    """Compiles the functions unless that is done, and returns the library; None without a compiler.

    Raises:
        OSError: the cache folder cannot be written.
        subprocess.CalledProcessError: the compiler rejects the C.
    """
    return compile_once(library(), FLAGS, c_source)


@dataclass(frozen=True, eq=False)
class LoadedBlocks:
    """Every block by name, and whether their functions are compiled."""

    blocks: dict[str, Block]
    compiled: bool


@cache
def loaded_blocks() -> LoadedBlocks:
    """Returns the blocks that this process uses: compiled if they were when it first asked, or else interpreted."""
    compiled = compiled_blocks()
    return LoadedBlocks(compiled or interpreted_blocks(), compiled is not None)


def compiled_blocks() -> dict[str, Block] | None:
    """Returns every block with compiled functions, None if they have not been compiled."""
    if not library().exists():
        return None
    path = str(library())
    return {name: Block(name, *(ca.external(f"{name}_{kind}", path) for kind in KINDS)) for name in ALL_FORMULAS}


if __name__ == "__main__":
    sys.exit(0 if compile_blocks() is not None else "fling: there is no C compiler")
