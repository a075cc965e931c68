"""A simulated Universal Robots controller: RTDE, dashboard and script port, an arm with a lag, a gripper, a flight.

It runs as a process of its own (`python -m executor.simulator --cell PATH`) and is imported by nobody.
docs/simulator.md describes its behaviour.
"""
