"""Arms from URDF files: what a description says of an arm of Universal Robots, and the cell file that says the same."""

from planner.urdf.cell_text import cell_from_urdf
from planner.urdf.surroundings import scene_of_urdf

__all__ = ["cell_from_urdf", "scene_of_urdf"]
