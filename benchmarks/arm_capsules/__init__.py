"""The capsules of the arms, made from the meshes that Universal Robots publishes, and how well they contain them.

    python -m benchmarks.arm_capsules FOLDER            says how far the capsules contain each arm's meshes
    python -m benchmarks.arm_capsules FOLDER --write    makes the capsules, and the extents that the tests take, anew

FOLDER is a copy of ur_description, with `config/` and `meshes/` (the ROS 2 package of Universal Robots). No mesh is
part of the project: what is written are lengths measured on them.
"""

from benchmarks.arm_capsules.extents import Extent, measured, measured_arms

__all__ = ["Extent", "measured", "measured_arms"]
