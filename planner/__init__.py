"""Fling's planner: the best motion that an arm can do, certified."""
