"""The arm of a ThrowBench problem, from its numbers alone: kinematics by the DH table, distances of its capsules."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Problem = dict[str, Any]

BOX_POINTS = 9  # points of a capsule's axis at which its distance from a box is taken
SEGMENT_STEPS = 4  # of alternating projections between two segments: to a millimetre or so


class PeerArm:
    """Arm, tool, object and surroundings of a problem.

    Args:
        problem: As docs/throwbench.md describes it.
    """

    def __init__(self, problem: Problem) -> None:
        arm = problem["arm"]
        tool = problem["tool"]
        limits = problem["limits"]
        self._a, self._d, self._alpha = (np.array(arm["dh"][k], float) for k in ("a_m", "d_m", "alpha_rad"))
        self._X_WB = _pose(problem["base"])
        self._p_FT = np.array(tool["position_m"], float)
        self.q_lower, self.q_upper = (np.array(limits[f"position_{k}_rad"], float) for k in ("lower", "upper"))
        self.qd_max, self.qdd_max, self.jerk_max = (
            np.array(limits[k], float) for k in ("velocity_rad_s", "acceleration_rad_s2", "jerk_rad_s3")
        )
        self.speed_max = float(limits["tool_speed_m_s"])
        self.radius = float(problem["object"]["radius_m"])
        self.start = np.array(problem["start"]["positions"], float)
        self.tau_max = np.array(limits["torque_n_m"], float)
        self._links, self._tool_mass = arm["links"], float(tool["mass_kg"])
        self._object_mass = float(problem["object"]["mass_kg"])
        self.around = problem["surroundings"]
        self.boxes = [_corners(box) for box in self.around["keep_out"]]
        self.keep_in = [_corners(box) for box in self.around["keep_in"]]
        self._bodies = [*arm["capsules"], self._object()]
        names = [body["name"] for body in self._bodies]
        self._pairs = np.array([[names.index(one) for one in pair] for pair in arm["collision_pairs"]], dtype=int)
        self._self_clearance = float(arm["self_clearance_m"])
        vessel = problem["target"]["bin"]
        if vessel is not None:  # the arm stays out of the block around the bin
            p = np.array(problem["target"]["position_m"], float)
            r = float(vessel["radius_m"])
            block = (p - np.array([r, r, 0.0]), p + np.array([r, r, float(vessel["rim_height_m"])]))
            self._arm_boxes = [*self.boxes, block]
        else:
            self._arm_boxes = self.boxes

    def _object(self) -> dict[str, Any]:
        return {"name": "object", "frame": 6, "from_m": self._p_FT, "to_m": self._p_FT, "radius_m": self.radius}

    def frames(self, q: Vector) -> Vector:
        """Returns the poses (n, 7, 4, 4) of base and DH frames in the world at joint positions (n, 6)."""
        X = [np.broadcast_to(self._X_WB, (len(q), 4, 4))]
        for i in range(6):
            X.append(X[-1] @ _dh(q[:, i], self._a[i], self._d[i], self._alpha[i]))
        return np.stack(X, axis=1)

    def tool(self, q: Vector) -> tuple[Vector, Vector]:
        """Returns positions (n, 3) and Jacobians (n, 3, 6) of the tool centre point in the world."""
        X = self.frames(q)
        p = X[:, 6, :3, :3] @ self._p_FT + X[:, 6, :3, 3]
        axes = X[:, :6, :3, 2]
        origins = X[:, :6, :3, 3]
        return p, np.swapaxes(np.cross(axes, p[:, None] - origins), 1, 2)

    def room(self, q: Vector, held: bool = True) -> Vector:
        """Returns what is left of all clearances (n,) [m] at postures (n, 6); negative where one is broken."""
        X = self.frames(q)
        p0 = self._ends(X, "from_m")
        p1 = self._ends(X, "to_m")
        radii = np.array([body["radius_m"] for body in self._bodies])
        last = len(self._bodies) if held else len(self._bodies) - 1
        moving = [i for i in range(last) if self._bodies[i]["frame"] > 0]
        clearance = self.around["clearance_m"]
        low = np.minimum(p0[..., 2], p1[..., 2]) - radii - self.around["floor_z_m"]
        least = low[:, moving].min(axis=1) - clearance
        axis = p0[:, moving, None] + np.linspace(0, 1, BOX_POINTS)[:, None] * (p1 - p0)[:, moving, None]
        for lower, upper in self._arm_boxes:
            gap = np.linalg.norm(axis - np.clip(axis, lower, upper), axis=-1).min(axis=-1) - radii[moving]
            least = np.minimum(least, gap.min(axis=1) - clearance)
        for lower, upper in self.keep_in:
            p = p0[:, -1]
            least = np.minimum(least, np.minimum(p - lower, upper - p).min(axis=1))
        pairs = self._pairs if held else self._pairs[(self._pairs < last).all(axis=1)]
        i, j = pairs.T
        apart = _segments(p0[:, i], p1[:, i], p0[:, j], p1[:, j]) - radii[i] - radii[j]
        return np.minimum(least, apart.min(axis=1) - self._self_clearance)

    def gaps(self, q: Vector, x: Vector) -> Vector:
        """Returns distances (n, m) of points (n, 3) from the m capsules before the flange, in postures (n or 1, 6)."""
        X = self.frames(q)
        links = [i for i, body in enumerate(self._bodies) if body["frame"] < 6]
        p0 = self._ends(X, "from_m")[:, links]
        p1 = self._ends(X, "to_m")[:, links]
        radii = np.array([self._bodies[i]["radius_m"] for i in links])
        share = _share(x[:, None] - p0, p1 - p0)
        return np.linalg.norm(x[:, None] - p0 - share[..., None] * (p1 - p0), axis=-1) - radii

    def torques(self, q: Vector, qd: Vector, qdd: Vector, held: bool) -> Vector:
        """Returns joint torques (n, 6) [N m] by Newton and Euler, in the world's axes."""
        X = self.frames(q)
        R = X[..., :3, :3]
        o = X[..., :3, 3]
        w = np.zeros((len(q), 3))
        dw = np.zeros((len(q), 3))
        a = np.tile([0.0, 0.0, self.around["gravity_m_s2"]], (len(q), 1))
        moments = np.zeros((len(q), 6, 3))
        force = np.zeros((len(q), 6, 3))
        for i in range(6):
            z = R[:, i, :, 2]
            dw = dw + qdd[:, i, None] * z + np.cross(w, qd[:, i, None] * z)
            w = w + qd[:, i, None] * z
            arm = o[:, i + 1] - o[:, i]
            a = a + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
            for mass, com, inertia in self._masses(i, held):
                r = (R[:, i + 1] @ com[:, None])[..., 0]
                f = mass * (a + np.cross(dw, r) + np.cross(w, np.cross(w, r)))
                turned = R[:, i + 1] @ inertia @ np.swapaxes(R[:, i + 1], 1, 2)
                n = (turned @ dw[..., None])[..., 0] + np.cross(w, (turned @ w[..., None])[..., 0])
                force[:, i] += f
                moments[:, i] += n + np.cross(o[:, i + 1] + r, f)  # about the world's origin
        f = np.cumsum(force[:, ::-1], axis=1)[:, ::-1]
        n = np.cumsum(moments[:, ::-1], axis=1)[:, ::-1]
        return ((n - np.cross(o[:, :6], f)) * R[:, :6, :, 2]).sum(axis=-1)

    def _masses(self, i: int, held: bool) -> list[tuple[float, Vector, Vector]]:
        """Returns mass, centre and inertia of what moves with link `i`; tool and object are points."""
        link = self._links[i]
        none = np.zeros((3, 3))
        rows = [(link["mass_kg"], np.array(link["center_of_mass_m"]), np.array(link["inertia_kg_m2"]))]
        if i == 5:
            rows += [(self._tool_mass, 0.5 * self._p_FT, none)] + [(self._object_mass, self._p_FT, none)] * held
        return rows

    def _ends(self, X: Vector, key: str) -> Vector:
        local = np.array([body[key] for body in self._bodies], float)
        X = X[:, [body["frame"] for body in self._bodies]]
        return (X[..., :3, :3] @ local[..., None])[..., 0] + X[..., :3, 3]


def _pose(document: dict[str, Any]) -> Vector:
    X = np.eye(4)
    X[:3, :3] = document["rotation"]
    X[:3, 3] = document["position_m"]
    return X


def _corners(box: dict[str, Any]) -> tuple[Vector, Vector]:
    return np.array(box["lower_m"], float), np.array(box["upper_m"], float)


def _dh(q: Vector, a: float, d: float, alpha: float) -> Vector:
    """Returns the DH transforms (n, 4, 4): turn by q, move by d along z; then move by a, turn by alpha along x."""
    c = np.cos(q)
    s = np.sin(q)
    ca = np.cos(alpha)
    sa = np.sin(alpha)
    zero = np.zeros_like(q)
    one = np.ones_like(q)
    rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [zero, sa * one, ca * one, d * one]]
    return np.moveaxis(np.array([*rows, [zero, zero, zero, one]]), -1, 0)


def _segments(a0: Vector, a1: Vector, b0: Vector, b1: Vector) -> Vector:
    """Returns distances (n, m) between segments, by alternating projections: never below the true ones."""
    u = a1 - a0
    v = b1 - b0
    s = t = np.full(a0.shape[:-1], 0.5)
    for _ in range(SEGMENT_STEPS):
        t = _share(a0 + s[..., None] * u - b0, v)
        s = _share(b0 + t[..., None] * v - a0, u)
    return np.linalg.norm(a0 + s[..., None] * u - b0 - t[..., None] * v, axis=-1)


def _share(x: Vector, along: Vector) -> Vector:
    return np.clip((x * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0.0, 1.0)
