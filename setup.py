"""What a wheel holds besides modules: the shipped cells, and `planner.native` compiled. The rest: pyproject.toml."""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig
import time
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py
from setuptools.errors import CompileError

ROOT = Path(__file__).parent
NATIVE = Path("planner", "native")
WRITTEN = ROOT / "build" / "native"  # the optimiser's C, and all that is compiled
# Multiplications and additions are not fused: every processor rounds alike.
# gcc takes vectors that are filled lane by lane for uninitialised ones.
COMMON = ["-ffp-contract=off", "-fno-math-errno", "-Wno-psabi", "-Wno-maybe-uninitialized", "-g0"]
# What else a compiler does takes twice the time with straight-line code, and makes it no faster.
STRAIGHT = ["-Og"]
TELL_S = 10.0  # [s] between two lines about what is being built
KERNEL = Extension(
    "planner.native.kernel",
    [str(NATIVE / "kernel" / f"{name}.c") for name in ("arm", "bounds", "flights", "paths", "states", "velocities")],
    depends=[str(NATIVE / "kernel" / "vectors.h")],
    extra_compile_args=[*COMMON, "-O3"],
    libraries=["m"],
    py_limited_api=True,
)
OPTIMISER = Extension(
    "planner.native.optimiser",
    [str(NATIVE / "optimiser" / f"{name}.c") for name in ("launch", "products")],
    depends=[str(NATIVE / "optimiser" / name) for name in ("lanes.h", "products.h")],
    include_dirs=[str(NATIVE / "optimiser")],
    extra_compile_args=[*COMMON, "-O2"],
    libraries=["m"],
    py_limited_api=True,
)


class BuildWithCells(build_py):
    """Copies the cells into the package `fling`; an editable install uses those of the checkout."""

    def run(self) -> None:
        """Builds."""
        super().run()
        if not self.editable_mode:
            shutil.copytree(ROOT / "cells", Path(self.build_lib) / "fling" / "cells", dirs_exist_ok=True)


class BuildNative(build_ext):
    """Has casadi write the optimiser's C, and compiles on all processors what is newer than its object."""

    def run(self) -> None:
        """Builds, into the checkout for an editable install."""
        self._is_in_checkout = bool(self.inplace or self.editable_mode)
        super().run()

    def build_extensions(self) -> None:
        """Builds both parts of the extension.

        Raises:
            CompileError: there is no C compiler, or it rejects the C.
        """
        compiler = self.compiler.compiler[0]
        if shutil.which(compiler) is None:
            raise CompileError(f"building Fling from source needs a C compiler: there is no {compiler}")
        self.build_temp = str(WRITTEN)
        self.compiler.linker_so = [
            part for part in self.compiler.linker_so if not part.startswith(("-L", "-Wl,-rpath"))
        ]  # where Python's own libraries are: none is needed
        self._compile = self.compiler.compile
        self.compiler.compile = self._compile_side_by_side
        self._link_to_fatrop()
        OPTIMISER.sources += [str(file.relative_to(ROOT)) for file in written_blocks()]
        super().build_extensions()

    def _link_to_fatrop(self) -> None:
        """Links the optimiser to casadi's fatrop, which is a folder beside it where the package is installed.

        fatrop is named though little of it is called, and found by the optimiser's own search path: see products.c.
        """
        import casadi

        folder = Path(casadi.__file__).parent
        OPTIMISER.include_dirs.append(str(folder / "include"))
        OPTIMISER.extra_link_args = ["-Wl,--no-as-needed", str(next(folder.glob("libfatrop.so.*")))]
        # An isolated build has a casadi of its own, which is gone afterwards: the one to load is beside the packages.
        installed = Path(sysconfig.get_path("platlib"), "casadi")
        beside = ["$ORIGIN/../../casadi"]
        OPTIMISER.runtime_library_dirs = [str(installed), str(folder)] if self._is_in_checkout else beside

    def _compile_side_by_side(self, sources: list[str], *, depends: list[str], **options: object) -> list[str]:
        """Returns the objects of C files, compiled where they are older than what they are made of."""
        since = max(os.path.getmtime(file) for file in (__file__, *depends))
        one = partial(self._compile_one, since, options)
        largest_first = sorted(sources, key=os.path.getsize, reverse=True)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            running = [pool.submit(one, source) for source in largest_first]
            tell_until_done(running, "compiled")
            return [done.result() for done in running]

    def _compile_one(self, since: float, options: dict[str, object], source: str) -> str:
        (made,) = self.compiler.object_filenames([source], output_dir=self.build_temp)
        is_current = os.path.exists(made) and os.path.getmtime(made) > max(since, os.path.getmtime(source))
        if not is_current:
            is_written = WRITTEN in (ROOT / source).parents
            more = [*options["extra_postargs"], *(STRAIGHT if is_written else [])]
            self._compile([source], **{**options, "extra_postargs": more})
        return made


def written_blocks() -> list[Path]:
    """Returns the C files of the optimiser's functions, written unless they are newer than the formulas."""
    sys.path.insert(0, str(ROOT))
    from planner.backends.casadi_nlp.emission import write_block
    from planner.backends.casadi_nlp.symbols import ALL_FORMULAS

    WRITTEN.mkdir(parents=True, exist_ok=True)
    formulas = (ROOT / "planner" / "backends" / "casadi_nlp").rglob("*.py")
    changed = max(file.stat().st_mtime for file in formulas)
    files = {name: WRITTEN / f"{name}.c" for name in ALL_FORMULAS}
    missing = [name for name, file in files.items() if not file.exists() or file.stat().st_mtime < changed]
    with ProcessPoolExecutor() as pool:  # casadi takes seconds for some
        running = [pool.submit(write_block, name, folder=WRITTEN) for name in missing]
        tell_until_done(running, "written")
        for done in running:
            done.result()
    return list(files.values())


def tell_until_done(running: Sequence[Future], verb: str) -> None:
    """Waits for what is done with files, and says every few seconds on standard error how far it is."""
    begun_s = time.monotonic()
    while wait(running, timeout=TELL_S).not_done:
        count = sum(one.done() for one in running)
        print(f"  {count} of {len(running)} files {verb}, {time.monotonic() - begun_s:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    setup(
        ext_modules=[KERNEL, OPTIMISER],
        cmdclass={"build_py": BuildWithCells, "build_ext": BuildNative},
        options={
            "bdist_wheel": {"py_limited_api": "cp311"},  # nothing of Python's interface is used
            # This folder on the path, so that `import fling` works beside a clone that is called "fling", too.
            "editable_wheel": {"mode": "compat"},
        },
    )
