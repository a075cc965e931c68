"""The executor: owns the robot of one cell, one execution at a time, and every way out of its loop is a stop."""
