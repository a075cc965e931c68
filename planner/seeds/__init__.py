"""Release states to begin a search from."""
