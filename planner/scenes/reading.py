"""Which program wrote a scene, and its shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from planner.documents import NotXml, parse_xml, read_file
from planner.errors import FileRefused
from planner.scenes.foreign import ForeignScene, SceneRefused
from planner.scenes.mjcf import scene_of_mjcf
from planner.scenes.moveit import read_scene_text, scene_of_message
from planner.scenes.sdf import scene_of_sdf

SCENE_BYTES = 20_000_000  # [byte] of a scene; one of MotionBenchMaker has 20,000, one with meshes in it millions
LEVELS = 12  # of lists and mappings in YAML; a planning scene has seven


def read_scene(path: Path) -> ForeignScene:
    """Returns the shapes of a scene of MoveIt (`.scene`, YAML), SDF or MJCF.

    Raises:
        FileRefused: it cannot be read, or is none of these.
    """
    data = read_file(path, SCENE_BYTES)
    try:
        if path.suffix.lower() == ".scene":
            return read_scene_text(data.decode(errors="replace"))
        if path.suffix.lower() in (".yaml", ".yml"):
            return scene_of_message(_yaml(data), path.parent)
        root = parse_xml(data)
        if root.tag == "sdf":
            return scene_of_sdf(root, path.parent)
        if root.tag == "mujoco":
            return scene_of_mjcf(root, path.parent)
        if root.tag == "robot":
            raise SceneRefused("is a URDF, or a xacro to be expanded to one, and its name has to end in .urdf")
        raise SceneRefused(f"begins with <{root.tag[:40]}>: no URDF, SDF or MJCF")
    except (SceneRefused, NotXml) as error:
        raise FileRefused(path, str(error)) from error


def _yaml(data: bytes) -> Any:
    """Returns the first document of a YAML file, all of its values as texts."""
    import yaml  # with the first scene: most processes do without

    try:
        events = yaml.parse(data, yaml.CBaseLoader if hasattr(yaml, "CBaseLoader") else yaml.BaseLoader)
        if any(isinstance(event, yaml.AliasEvent) for event in events):
            raise SceneRefused("has aliases (*NAME), which no scene needs")
        documents = yaml.load_all(data, yaml.CBaseLoader if hasattr(yaml, "CBaseLoader") else yaml.BaseLoader)
        return next(iter(documents), None)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise SceneRefused(f"is not YAML: {' '.join(str(error).split())[:200]}") from error
