"""C compiled for this machine, and compiled twins of the numpy functions that certificates and candidates live on.

numpy takes about as long for one instant as for a hundred: what counts is the number of its operations. Four small C
files do them in one pass. Without a compiled library, or where it disagrees with numpy, numpy does the work.
"""

from planner.kernel.arguments import Pinned
from planner.kernel.compilation import SHARED, compile_once, library_path
from planner.kernel.library import Kernel, compile_kernel, loaded
from planner.kernel.twin import twin_of

__all__ = ["SHARED", "Kernel", "Pinned", "compile_kernel", "compile_once", "library_path", "loaded", "twin_of"]
