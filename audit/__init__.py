"""The audit of many plans: random cells and requests, planned, and each certified plan judged by foreign code."""
