"""A simulated Universal Robots controller: RTDE, dashboard and script port, an arm with a lag, a gripper, a flight.

It runs as a process of its own (`python -m simulator --cell PATH`) and no other package imports it.
docs/simulator.md describes its behaviour.
"""
