"""ThrowBench: versioned problems, an independent judge and one table that other planners can enter.

docs/throwbench.md describes problems, answers, rules and entries.
"""

from benchmarks.throwbench.judge import Verdict, verify
from benchmarks.throwbench.sets import HASHES, HIDDEN, hash_of, hidden_problems, load_set

__all__ = ["HASHES", "HIDDEN", "Verdict", "hash_of", "hidden_problems", "load_set", "verify"]
