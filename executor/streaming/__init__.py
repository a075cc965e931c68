"""The streaming process: ur_rtde and nothing else, one thread, one command a tick, and every way out is a stop."""
