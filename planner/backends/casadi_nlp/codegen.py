"""Machine code of the optimiser: C of the blocks' functions, and a launch for fatrop, in the user's cache folder.

The file names are hashes of the modules that hold the formulas, of the C and of the compiler's options, so a changed
formula gives another file. Nothing is compiled while a request waits: without a file, the interpreted functions are
used. A wheel carries the C, so that only the compiler has to run.
"""

from __future__ import annotations

import hashlib
import logging
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import casadi as ca

from planner.backends.casadi_nlp import emission
from planner.backends.casadi_nlp.functions import KINDS, Block, interpreted_blocks
from planner.backends.casadi_nlp.symbols import ALL_FORMULAS
from planner.kernel import SHARED, compile_once, library_path

PROCESSOR = Path("/proc/cpuinfo")  # on Linux
# Fused operations would round otherwise than the interpreter.
COMMON_FLAGS = ("-fno-math-errno", "-ffp-contract=off", "-Wno-psabi", *SHARED)
BLOCKS_FLAGS = ("-O1", *COMMON_FLAGS)  # -O2 takes longer to compile without a faster solve
LAUNCH_FLAGS = ("-O2", "-D_GNU_SOURCE", *COMMON_FLAGS)
SHIPPED_C = Path(__file__).with_name("blocks.c")  # in wheels alone: setup.py writes it
SYMBOLS = ("__init__", "arm", "distances", "passing", "rows", "stage", "terms")
FORMULA_MODULES = ("emission", "functions", "layout", *(f"symbols/{name}" for name in SYMBOLS))  # sources of the C
LAUNCH_C = tuple(emission.HEADER.with_name(name) for name in ("lanes.h", "linear_algebra.c", "launch.c"))
CASADI = Path(ca.__file__).parent
UNIT = "\n/* --- */\n"  # between the parts of the C that are compiled side by side
AVX2 = ("-mavx2",)
ANY_PROCESSOR = ()
MOST_DIFFER = (True, False, True)  # arguments that differ from stage to stage: z and multipliers, not the parameters
EACH_DIFFERS = (True, True, True)  # of the costs


def c_source() -> str:
    """Returns the C of all blocks: the shipped one if it follows from these formulas, or else newly written."""
    with suppress(OSError):
        shipped = SHIPPED_C.read_text()
        if shipped.startswith(_origin()):
            return shipped
    return UNIT.join([_origin(), *_written_c()])


def _origin() -> str:
    """Returns the first line of the C: what it follows from."""
    digest = hashlib.sha256(ca.CasadiMeta.version().encode())
    for source in _formulas():
        digest.update(source)
    return f"/* {digest.hexdigest()} */\n"


def _formulas() -> Iterator[bytes]:
    yield from (Path(__file__).parent.joinpath(f"{module}.py").read_bytes() for module in FORMULA_MODULES)
    yield emission.HEADER.read_bytes()


def _written_c() -> Iterator[str]:
    for block in interpreted_blocks().values():
        differs = EACH_DIFFERS if block.name == "cost" else MOST_DIFFER
        yield emission.written([(function, differs[: function.n_in()]) for function in block.functions])


@cache
def _processor_flags() -> tuple[str, ...]:
    """Returns the flags for this processor: with AVX2, four numbers side by side instead of two."""
    with suppress(OSError):
        lines = PROCESSOR.read_text().splitlines()
        if any(line.startswith("flags") and "avx2" in line.split() for line in lines):
            return AVX2
    return ANY_PROCESSOR


@cache
def _flags() -> tuple[str, ...]:
    """Returns the flags of the libraries that are used: those for any processor where there are no others."""
    own = _processor_flags()
    return own if _blocks_path(own).exists() or not _blocks_path(ANY_PROCESSOR).exists() else ANY_PROCESSOR


def library() -> Path:
    """Returns the path of the compiled functions, whether they exist or not."""
    return _blocks_path(_flags())


def launch_library() -> Path | None:
    """Returns the path of the compiled launch, whether it exists or not; None where casadi brings no fatrop."""
    return _launch_path(_flags())


@cache
def _blocks_path(processor: tuple[str, ...]) -> Path:
    return library_path("blocks", (*BLOCKS_FLAGS, *processor), _formulas(), writer=ca.CasadiMeta.version())


@cache
def _launch_path(processor: tuple[str, ...]) -> Path | None:
    linked = _linked()
    flags = (*LAUNCH_FLAGS, *processor, *linked)
    return library_path("launch", flags, (file.read_bytes() for file in LAUNCH_C)) if linked else None


def _linked() -> tuple[str, ...]:
    """Returns what the launch is linked to, nothing where casadi brings no fatrop.

    fatrop is named though little of it is called, and found where casadi finds it: see linear_algebra.c.
    """
    fatrop = min(CASADI.glob("libfatrop.so.*"), default=None)
    if fatrop is None:
        return ()
    return ("-Xlinker", "--no-as-needed", str(fatrop), "-Xlinker", "-rpath", "-Xlinker", str(CASADI))


def compile_blocks() -> Path | None:
    """Compiles the functions and the launch for this processor, unless that is done.

    Returns:
        The library of the functions; None without a compiler.

    Raises:
        OSError: the cache folder cannot be written.
        subprocess.CalledProcessError: the compiler rejects the C.
    """
    return _compile_for(_flags())


def _compile_for(processor: tuple[str, ...]) -> Path | None:
    launch = _launch_path(processor)
    if launch is not None:
        flags = (*LAUNCH_FLAGS, *processor, f"-I{CASADI / 'include'}")
        try:
            compile_once(launch, flags, lambda: ["\n".join(file.read_text() for file in LAUNCH_C)], _linked())
        except subprocess.CalledProcessError as error:  # another version of fatrop: casadi's own interface is used
            logging.getLogger(__name__).warning("no launch for this fatrop: %s", error.stderr.decode(errors="replace"))
    return compile_once(_blocks_path(processor), (*BLOCKS_FLAGS, *processor), lambda: c_source().split(UNIT)[1:])


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
    made = _compile_for(ANY_PROCESSOR if sys.argv[1:] == ["--any-processor"] else _flags())
    sys.exit(0 if made is not None else "fling: there is no C compiler")
