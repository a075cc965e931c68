"""The benchmark: named problem sets with fixed seeds, every back end, peers, an independent audit, one report."""
