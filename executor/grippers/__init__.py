"""Grippers that no digital output switches: a driver a module, and the connection that daemon and stream share.

Of the standard library alone: the streaming process imports it.
"""

from executor.grippers.calls import PROGRAM
from executor.grippers.connection import GripperConnection, GripperUnavailable
from executor.grippers.drivers import driver_of
from executor.grippers.protocol import GripperDriver

__all__ = ["PROGRAM", "GripperConnection", "GripperDriver", "GripperUnavailable", "driver_of"]
