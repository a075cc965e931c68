"""System tests: real processes, the real ur_rtde client, a simulated controller."""
