"""Twins of grippers with a bus or a network: what clients of them see, around the simulated gripper's fingers."""

from simulator.grippers.ports import PORT_NAME, gripper_ports

__all__ = ["PORT_NAME", "gripper_ports"]
