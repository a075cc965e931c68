"""What peers share of motions: Ruckig's launch and brake, samples on ticks, a filter that limits the jerk, answers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.arm import PeerArm
from benchmarks.peers.releases import OUT_M, ThrowState

Vector = NDArray[np.float64]
Answer = dict[str, Any]

WITHIN = 0.998  # [-] of the limits, for rounding
FLIGHT_S = 0.6  # [s] after the release, in which the object may meet the arm
CHECKED_S = 0.008  # [s] between postures whose clearances are looked at


def refusal(reason: str) -> Answer:
    """Returns the answer of a planner that found nothing."""
    return {"refused": reason}


def answer(q: Vector, qd: Vector, release: int, rate: float) -> Answer:
    """Returns the answer of samples (n, 6) on ticks, released at sample `release`."""
    return {"positions": q.tolist(), "velocities": qd.tolist(), "release_time_s": release / rate}


def is_right(arm: PeerArm, rate: float, q: Vector, qd: Vector, release: int) -> bool:
    """Returns whether samples (n, 6) keep positions, torques, tool speed and clearances, and the flight the arm's."""
    if np.any(q < arm.q_lower) or np.any(q > arm.q_upper):
        return False
    p, J = arm.tool(q)
    speed = np.einsum("nij,nj->ni", J, qd)
    if np.linalg.norm(speed, axis=1).max() > WITHIN * arm.speed_max:
        return False
    every = max(1, round(CHECKED_S * rate))
    t = np.arange(0.0, FLIGHT_S, CHECKED_S)[:, None]
    x = p[release] + t * speed[release] - 0.5 * t**2 * [0.0, 0.0, arm.around["gravity_m_s2"]]
    places = q[np.minimum(release + np.round(t[:, 0] * rate).astype(int), len(q) - 1)]
    if arm.gaps(places, x)[np.linalg.norm(x - x[0], axis=1) > OUT_M].min() < arm.radius:
        return False
    for rows, held in ((slice(0, release + 1), True), (slice(release, len(q)), False)):
        place = q[rows]
        velocity = qd[rows]
        if len(place) < 2:
            continue
        mean = 0.5 * (velocity[1:] + velocity[:-1])
        change = np.diff(velocity, axis=0) * rate
        tau = arm.torques(place[:-1], mean, change, held)
        if np.any(np.abs(tau) > WITHIN * arm.tau_max) or arm.room(place[::every], held).min() < 0.0:
            return False
    return True


def ruckig_motion(
    arm: PeerArm, rate: float, begin: tuple[Vector, Vector, Vector], end: tuple[Vector | None, Vector, Vector]
) -> tuple[Vector, Vector, Vector] | None:
    """Returns Ruckig's soonest motion between two joint states, sampled on ticks from its begin on; None without one.

    Args:
        arm: Gives the limits.
        rate: Ticks per second.
        begin: Positions, velocities, accelerations (6,).
        end: The same; positions None: free, as for a brake.
    """
    import ruckig

    request = ruckig.InputParameter(6)
    request.current_position, request.current_velocity, request.current_acceleration = begin
    if end[0] is None:
        request.control_interface = ruckig.ControlInterface.Velocity
    else:
        request.target_position = end[0]
    request.target_velocity = end[1]
    request.target_acceleration = end[2]
    request.max_velocity = WITHIN * arm.qd_max
    request.max_acceleration = WITHIN * arm.qdd_max
    request.max_jerk = WITHIN * arm.jerk_max
    request.duration_discretization = ruckig.DurationDiscretization.Discrete
    motion = ruckig.Trajectory(6)
    try:
        if ruckig.Ruckig(6, 1.0 / rate).calculate(request, motion) < 0:
            return None
    except ruckig.RuckigError:
        return None
    samples = [motion.at_time(i / rate) for i in range(round(motion.duration * rate) + 1)]
    q, qd, qdd = (np.array([sample[k] for sample in samples]) for k in range(3))
    return q, qd, qdd


def braked(arm: PeerArm, rate: float, q: Vector, qd: Vector, qdd: Vector) -> tuple[Vector, Vector, int] | None:
    """Returns a launch (n, 6) with Ruckig's brake from its last sample: positions, velocities, release index."""
    brake = ruckig_motion(arm, rate, (q[-1], qd[-1], qdd), (None, np.zeros(6), np.zeros(6)))
    if brake is None:
        return None
    return np.concatenate([q, brake[0][1:]]), np.concatenate([qd, brake[1][1:]]), len(q) - 1


def averaged(arm: PeerArm, rate: float) -> int:
    """Returns over how many ticks, an even number, `smooth` averages: enough for the jerk of any acceleration."""
    return int(np.ceil(np.max(2.0 * arm.qdd_max / (WITHIN * arm.jerk_max)) * rate / 2.0)) * 2


def smooth(arm: PeerArm, rate: float, start: Vector, qd: Vector) -> tuple[Vector, Vector, int]:
    """Returns positions and velocities (n, 6) of a motion averaged over a moving window, and its delay in ticks.

    The mean over a window keeps limits of velocity and acceleration, and limits the jerk. Where the velocity is
    constant for as long, it changes nothing.

    Args:
        arm: Gives the limits.
        rate: Ticks per second.
        start: Positions at rest (6,).
        qd: Velocities on ticks (n, 6), linear between them, from rest to rest.
    """
    width = averaged(arm, rate)
    rest = np.zeros((width, 6))
    padded = np.concatenate([rest, qd, rest])
    sums = np.cumsum(np.concatenate([np.zeros((1, 6)), 0.5 * (padded[1:] + padded[:-1])]), axis=0)
    v = (sums[width:] - sums[:-width]) / width
    a = (padded[width:] - padded[:-width]) * rate / width
    steps = 0.5 * (v[1:] + v[:-1]) / rate - (a[1:] - a[:-1]) / (12.0 * rate**2)  # exact: a is linear in each tick
    return np.concatenate([[start], start + np.cumsum(steps, axis=0)]), v, width // 2


def straight_throw(arm: PeerArm, rate: float, state: ThrowState) -> tuple[Vector, Vector, int]:
    """Returns a throw along a straight line in joint space: start (6,), velocities on ticks (n, 6), release index.

    Every joint accelerates uniformly from rest to its velocity at the release, keeps it for as long as `smooth`
    averages, and decelerates in the same way.
    """
    ramp = int(np.ceil(np.max(np.abs(state.qd) / (WITHIN * arm.qdd_max)) * rate))
    keep = averaged(arm, rate) // 2
    up = np.linspace(0.0, 1.0, ramp + 1)
    share = np.concatenate([up, np.ones(2 * keep), up[-2::-1]])
    return state.q - state.qd * (0.5 * ramp + keep) / rate, share[:, None] * state.qd, ramp + keep


def line(arm: PeerArm, rate: float, way: Vector) -> Vector:
    """Returns velocities on ticks (n, 6) of a straight motion by `way` (6,), at constant acceleration and deceleration.

    It is as soon as velocities and accelerations allow without a stretch of constant velocity.
    """
    far = np.abs(way) / WITHIN
    half_s = max(np.sqrt(far / arm.qdd_max).max(), (far / arm.qd_max).max())
    half = max(1, int(np.ceil(half_s * rate)))
    up = np.linspace(0.0, 1.0, half + 1)
    return np.concatenate([up, up[-2::-1]])[:, None] * way * rate / half


def thrown(arm: PeerArm, rate: float, approach: Vector, state: ThrowState) -> tuple[Vector, Vector, int]:
    """Returns an approach (n, 6) to the run-up posture and the straight throw from there, smoothed, with its release.

    Args:
        arm: Gives the limits.
        rate: Ticks per second.
        approach: Velocities on ticks, from the start of the problem to the run-up posture, from rest to rest.
        state: The release.
    """
    _, throw, release = straight_throw(arm, rate, state)
    rest = np.zeros((averaged(arm, rate), 6))  # both are smoothed apart
    q, qd, later = smooth(arm, rate, arm.start, np.concatenate([approach, rest, throw]))
    return q, qd, len(approach) + len(rest) + release + later
