"""How well timing, release and flight are learnt, on hidden cells drawn by a seed."""
