"""Other planners as entries of ThrowBench: written from docs/throwbench.md alone, they import nothing else of Fling.

A peer's module is loaded by its name, `benchmarks.peers.ruckig_alone:plan`, in a process of its own. It gets a problem
as a dictionary and returns an answer as one. `arm`, `releases` and `motions` are what several of them share; packages
that not everybody has (ruckig, casadi, toppra, drake) are imported by the peer that needs them.
"""

__all__: list[str] = []
