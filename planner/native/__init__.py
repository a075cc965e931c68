"""C that is compiled when the package is built: the kernel, and the optimiser with its calls of fatrop.

numpy takes about as long for one instant as for a hundred: what counts is the number of its operations. The kernel does
the planner's hot loops in one pass. `loops` calls it, and tests/planner/native has a numpy oracle for each of its
functions. The executor, which certifies too, loads the kernel alone.
"""

from planner.native.arguments import Pinned
from planner.native.libraries import OPTIMISER

__all__ = ["OPTIMISER", "Pinned"]
