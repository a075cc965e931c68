"""Arms from URDF files: what a description says of an arm of Universal Robots, and the cell file that says the same."""

from planner.urdf.cell_text import cell_from_urdf

__all__ = ["cell_from_urdf"]
