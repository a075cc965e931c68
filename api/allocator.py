"""The C library's allocator, told to return to the machine what large requests needed.

By itself glibc keeps a heap for every few threads, and after one large buffer takes the next ones from these heaps,
where a small object behind them keeps them all. A burst of bodies of a megabyte then stays as resident memory.
"""

from __future__ import annotations

import ctypes

# source: malloc.h of glibc
M_TRIM_THRESHOLD = -1
M_MMAP_THRESHOLD = -3
M_ARENA_MAX = -8
LARGE_BYTES = 131_072  # [byte] from here on a buffer is mapped by itself, and unmapped: glibc's own first threshold
HEAPS = 1  # threads of one interpreter allocate in turn anyway


def give_memory_back() -> None:
    """Fixes the allocator's thresholds, which adapt otherwise; nothing where the C library is another one."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return
    for option, value in ((M_ARENA_MAX, HEAPS), (M_MMAP_THRESHOLD, LARGE_BYTES), (M_TRIM_THRESHOLD, LARGE_BYTES)):
        mallopt(option, value)
