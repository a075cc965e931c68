"""Back ends: one module each, all of the same shape.

`solve(problem, candidate) -> Solution` returns a motion from the problem's start at rest through the candidate's
release state to rest, one jerk a tick, or raises `Infeasible` or `SolverFailed`. A back end knows neither the
certificate nor another back end.
"""
