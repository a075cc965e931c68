"""The search for a plan: which back end, from which seeds, and what instead where there is none."""
