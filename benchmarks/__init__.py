"""The benchmark: named problem sets with fixed seeds, every back end, an independent audit, one report."""
