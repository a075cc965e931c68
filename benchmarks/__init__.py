"""Measurements and comparisons; nothing of it is installed."""
