"""Motion planning that ends at rest: the approach to a plan's start, and a brake from every row of a motion."""

from planner.approach.approach import APPROACH_ACCELERATION, APPROACH_SPEED, NEAR_RAD, Approach, find_approach
from planner.approach.brakes import Brakes, brake_path, find_brakes
from planner.approach.posture import jog_advice, obstacle_words, too_close

__all__ = [
    "APPROACH_ACCELERATION",
    "APPROACH_SPEED",
    "NEAR_RAD",
    "Approach",
    "Brakes",
    "brake_path",
    "find_approach",
    "find_brakes",
    "jog_advice",
    "obstacle_words",
    "too_close",
]
