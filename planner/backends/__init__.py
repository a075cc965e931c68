"""Back ends: one module or package each, all with the same face.

`solve(problem, candidate, variant) -> Solution` returns a motion from the problem's start through the
candidate's release state to rest, with one constant jerk a tick; `VARIANTS` names what `variant` may be. The optimiser
takes a seed and options instead. A back end raises `SolverFailed` or `BackendUnavailable`. It imports neither the
certificate nor another back end.
"""
