"""The executor: one process owns the robot of one cell and runs one execution at a time.

Empty on purpose: the streaming process imports through here, and imports no numpy.
"""
