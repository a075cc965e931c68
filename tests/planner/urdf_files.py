"""URDF files of arms, written from the published parameters as `ur_description` does, for tests of what reads them."""

from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from audit.judge.published_arms import JOINTS, LINKS, SAME, published

TOOL = """
  <link name="{p}gripper">
    <inertial><origin xyz="0 0 0.06"/><mass value="0.7"/>
      <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>
  </link>
  <joint name="{p}tool0-gripper" type="fixed"><parent link="{p}tool0"/><child link="{p}gripper"/></joint>
  <link name="{p}tcp"/>
  <joint name="{p}gripper-tcp" type="fixed">
    <parent link="{p}gripper"/><child link="{p}tcp"/><origin xyz="0 0 0.12" rpy="0 0 0.3"/>
  </joint>"""


def numbers(values):
    return quoteattr(" ".join(repr(float(value)) for value in values))


def placed(X):
    """A pose as an <origin>."""
    return f"<origin xyz={numbers(X.translation)} rpy={numbers(pin.rpy.matrixToRpy(X.rotation))}/>"


def at(xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0)):
    return pin.SE3(pin.rpy.rpyToMatrix(*map(float, rpy)), np.array(xyz, dtype=float))


def fixed(p, parent, child, X):
    return [
        f'  <link name="{p}{child}"/>',
        f'  <joint name="{p}{parent}-{child}" type="fixed"><parent link="{p}{parent}"/><child link="{p}{child}"/>',
        f"    {placed(X)}</joint>",
    ]


def urdf_text(name, prefix="", tool=True, stand=None, offsets=None, axis=(0, 0, 1), limits=None):
    """The URDF of an arm on a table, with a tool.

    Args:
        name: of the published arm.
        prefix: before all names.
        tool: whether it has one.
        stand: pose of its base link in the world.
        offsets: added to the origins (6, 6) of the joints, x y z roll pitch yaw: a calibrated arm.
        axis: of the joints, in the frames of their links.
        limits: document of the joints' limits; by default the published one.
    """
    p = prefix
    origins = published(name, "default_kinematics")["kinematics"]
    mass = published(name, "physical_parameters")["inertia_parameters"]
    limits = published(name, "joint_limits")["joint_limits"] if limits is None else limits
    stand = at((0.3, -0.2, 0.8), (0.0, 0.0, 0.5)) if stand is None else stand
    lines = [
        f'<?xml version="1.0"?>\n<robot name="{p}{name if name in SAME else "arm"}">\n  <link name="{p}world"/>',
        *fixed(p, "world", "base_link", stand),
        *fixed(p, "base_link", "base_link_inertia", at(rpy=(0.0, 0.0, np.pi))),
    ]
    Q = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(axis, float)).matrix(), np.zeros(3))
    before = pin.SE3.Identity()
    parent = "base_link_inertia"
    for i, (link, joint) in enumerate(zip(LINKS, JOINTS, strict=True)):
        origin = np.array([float(origins[link][key]) for key in ("x", "y", "z", "roll", "pitch", "yaw")])
        origin = origin + (0.0 if offsets is None else offsets[i])
        com = [mass["center_of_mass"][f"{link}_cog"][key] for key in "xyz"]
        turn = [mass["rotation"][link][key] for key in ("roll", "pitch", "yaw")]
        tensor = " ".join(f'{key}="{value!r}"' for key, value in mass["tensor"][link].items())
        own = limits.get(f"{joint}_joint", {})
        ends = [float(own.get("min_position", -2 * np.pi)), float(own.get("max_position", 2 * np.pi))]
        lines += [
            f'  <link name="{p}{link}_link"><inertial>{placed(Q * at(com, turn))}',
            f'    <mass value="{mass[f"{link}_mass"]}"/><inertia {tensor}/></inertial></link>',
            f'  <joint name="{p}{joint}_joint" type="revolute"><parent link="{p}{parent}"/>',
            f'    <child link="{p}{link}_link"/>{placed(before * at(origin[:3], origin[3:]) * Q.inverse())}',
            f"    <axis xyz={quoteattr(' '.join(map(str, axis)))}/>",
            f'    <limit lower="{ends[0]!r}" upper="{ends[1]!r}" effort="{own["max_effort"]}"'
            f' velocity="{float(own["max_velocity"])!r}"/></joint>'
            if own
            else "  </joint>",
        ]
        before = Q
        parent = f"{link}_link"
    quarter = np.pi / 2
    lines += fixed(p, parent, "flange", Q * at(rpy=(0.0, -quarter, -quarter)))
    lines += fixed(p, "flange", "tool0", at(rpy=(quarter, 0.0, quarter)))
    return "\n".join([*lines, TOOL.format(p=p) if tool else "", "</robot>", ""])
