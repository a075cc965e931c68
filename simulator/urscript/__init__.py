"""URScript: the text of a script becomes a program of the controller, run cycle by cycle."""

from simulator.urscript.interpreter import Script

__all__ = ["Script"]
