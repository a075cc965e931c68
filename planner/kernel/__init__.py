"""Compiled twins of a few numpy functions that certificates and candidates spend their time in.

numpy takes about as long for one instant as for a hundred: what counts is the number of its operations. One small C
file does them in one pass. Without a compiled library, or where it disagrees with numpy, numpy does the work.
"""

from planner.kernel.library import Kernel, compile_kernel, loaded
from planner.kernel.twin import twin_of

__all__ = ["Kernel", "compile_kernel", "loaded", "twin_of"]
