"""Measured arms for tests, and plain products of their tables: an independent route to compare with."""

from pathlib import Path

import numpy as np

from planner.calibration import DhTable, calibrated, calibration_text, published_table, transforms_of_table
from planner.cell import parse_cell
from planner.robots import robot

CELLS = Path(__file__).parents[3] / "cells"

# A file of the ROS driver. source: public lecture notes on a real UR5e (`my_robot_calibration.yaml`)
UR5E_FILE = b"""
kinematics:
  shoulder: {x: 0, y: 0, z: 0.1627122445743823, roll: -0, pitch: 0, yaw: 5.707382499074709e-08}
  upper_arm: {x: 0.0001820110310317555, y: 0, z: 0, roll: 1.571314866107557, pitch: 0, yaw: 1.12157791523139e-06}
  forearm:
    x: -0.425170344631444
    y: 0
    z: 0
    roll: 0.001444320579376547
    pitch: -0.0004261037597356073
    yaw: 4.642343028998144e-06
  wrist_1:
    x: -0.392646598028507
    y: -0.0004030322688786401
    z: 0.1331063119537431
    roll: 0.003027888244224887
    pitch: -0.001185722601572754
    yaw: -2.569771029137183e-06
  wrist_2:
    x: -7.071306960874342e-06
    y: -0.09960359635829828
    z: -3.198591184007791e-07
    roll: 1.570799538115874
    pitch: 0
    yaw: 1.304820282092834e-06
  wrist_3:
    x: 1.369362273278849e-05
    y: 0.09958483828527664
    z: 9.521789789182917e-05
    roll: 1.571752475045119
    pitch: 3.141592653589793
    yaw: 3.141592510837143
  hash: calib_14698139022496758595
"""

# Deviations theta, a, d, alpha of a UR10 from the published table. source: UR's ROS driver, test of `ur_calibration`
UR10_DEVIATIONS = np.array(
    [
        [-7.29007e-05, -0.01713897289705, -0.03707159413492756, 0.05427946216058321, 1.488984257e-07, 1.5514994797e-05],
        [4.63113768349e-05, -0.0001256831533, 0.00186216581161458, 9.918593870679e-05, 4.215462720453e-06, 0.0],
        [0.00065609212980, 1.4442162376284788, 0.854147723854608, -2.29894258775637, -1.57349868e-05, 1.9072435e-05],
        [0.000211987863869, -0.0072553625957653, -0.01348322676954136, 0.00134958202273294, -0.0012631361636799, 0.0],
    ]
)  # fmt: skip


def deviated_table(name, rng, length=5e-3, angle=5e-3, flange=False):
    """A table with evenly drawn deviations of up to `length` [m] and `angle` [rad] from the published one."""
    model = published_table(robot(name))
    theta, alpha = rng.uniform(-angle, angle, (2, 6))
    a, d = rng.uniform(-length, length, (2, 6))
    if not flange:
        a[5] = alpha[5] = 0.0
    return DhTable(model.theta + theta, model.a + a, model.d + d, model.alpha + alpha)


def measured_arm(name, table):
    """The arm of a table."""
    return calibrated(robot(name), transforms_of_table(table))


def measured_cell(name, table):
    """A shipped cell whose arm has a table, read from a calibration file."""
    text = (CELLS / f"{name}.toml").read_text() + '\n[kinematics]\ncalibration = "measured.yaml"\n'
    published = parse_cell((CELLS / f"{name}.toml").read_text(), name).robot
    arm = calibrated(published, transforms_of_table(table))
    return parse_cell(text, name, calibration_text(arm.fixed, table.hash).encode())


def product_of(table, q):
    """Pose of the flange (4, 4) by the definition of Denavit and Hartenberg, one matrix after the other."""
    X = np.eye(4)
    for angle, (theta, a, d, alpha) in zip(q, table.rows, strict=True):
        c = np.cos(angle + theta)
        s = np.sin(angle + theta)
        ca = np.cos(alpha)
        sa = np.sin(alpha)
        X = X @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    return X
