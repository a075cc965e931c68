"""Fling's service: HTTP in front of the planner and the store, the command line, the web page."""
