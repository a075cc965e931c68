"""Motions that end at rest: the approach to a start, and brakes from every tick."""
