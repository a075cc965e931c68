"""Measurements of throwability maps: how fast, how true, and the same to the bit after kills."""
