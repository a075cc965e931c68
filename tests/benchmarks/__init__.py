"""The benchmark: named problem sets with fixed seeds, every back end, peers, one report. Run by `make bench`."""
