"""The streaming process: ur_rtde, one control loop, and nothing else.

Empty on purpose: the process imports through here, and imports no numpy.
"""
