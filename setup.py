"""What a wheel holds besides modules: the shipped cells, and the optimiser's generated C. The rest: pyproject.toml."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent


class BuildWithGeneratedFiles(build_py):
    """Copies the cells into the package `fling`, and writes the C beside the module that compiles it."""

    def run(self) -> None:
        """Builds; an editable install uses the files of the checkout, and writes none."""
        super().run()
        if not self.editable_mode:
            built = Path(self.build_lib)
            shutil.copytree(ROOT / "cells", built / "fling" / "cells", dirs_exist_ok=True)
            sys.path.insert(0, str(ROOT))
            from planner.backends.casadi_nlp.codegen import c_source

            (built / "planner" / "backends" / "casadi_nlp" / "blocks.c").write_text(c_source())


setup(cmdclass={"build_py": BuildWithGeneratedFiles})
