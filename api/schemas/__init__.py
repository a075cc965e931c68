"""What crosses HTTP: pydantic models whose descriptions name every unit."""
