"""The list of checks, and the function that makes a certificate of them.

To add a check, write a function `(motion: MotionSamples) -> Check | NotChecked | None` in the module of its family and
add it to `MOTION_CHECKS`. None means that the check does not apply to the problem; `NotChecked`, that the cell gives no
limit for it, or that the model cannot tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

from planner.certificate import clearance, grip, joints, passages, release, safety_limits, tool, torque
from planner.certificate.certificate import Certificate, Check, NotChecked
from planner.certificate.flight import flight_clearance
from planner.certificate.samples import MotionSamples
from planner.certificate.several import merged, together, with_kept
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

CheckFunction = Callable[[MotionSamples], Check | NotChecked | None]

# Checks of the joints alone, which hold for any samples.
JOINT_CHECKS: tuple[CheckFunction, ...] = (
    joints.start,
    joints.joint_position,
    joints.joint_velocity,
    joints.joint_acceleration,
    joints.joint_jerk,
    joints.end_at_rest,
    joints.continuity,
    joints.sample_rate,
)
# Checks that rest on a continuous motion.
MOTION_CHECKS: tuple[CheckFunction, ...] = (
    tool.tcp_speed,
    tool.tool_speed,
    clearance.floor,
    clearance.keep_in,
    clearance.keep_out,
    clearance.self_collision,
    clearance.arm_shape,
    clearance.tool_shape,
    clearance.may_touch,
    clearance.clearance,
    tool.singularity_distance,
    torque.joint_torque,
    torque.payload,
    *(quantity.check for quantity in safety_limits.WATCHED),
    release.landing_window,
    release.release_position,
    release.release_velocity,
    passages.passage,
    release.landing,
    release.landing_axis,
    flight_clearance,
    grip.grip_acceleration,
    grip.opening_direction,
)


# Of the checks that rest on a continuous motion, the cheapest and most selective first. The release window
# comes last of all: what fails nothing else is a throw at its nominal instant.
MOST_TELLING: tuple[CheckFunction, ...] = (
    clearance.self_collision,
    clearance.floor,
    grip.opening_direction,
    tool.tcp_speed,
    torque.joint_torque,
    flight_clearance,
)
LAST_CHECK: CheckFunction = release.landing_window
# Checks whose value is a bound, or exact, wherever they are first evaluated.
TOLD_BY_ITSELF: tuple[CheckFunction, ...] = (*JOINT_CHECKS, flight_clearance)


class Examination:
    """The checks of a trajectory, each made when it is first asked for.

    A search rejects most of what it tries: there it is enough to know which checks fail. Only a certificate tells how
    far a motion keeps from what it does not violate, and proves a bound on that.
    """

    def __init__(self, problem: ThrowProblem, trajectory: Trajectory, is_part: bool = False) -> None:
        """Takes a trajectory, and the problem that it is to solve; that of one of several grippers is a part."""
        self._is_part = is_part
        self._problem = problem
        self._trajectory = trajectory
        self._motion = MotionSamples(problem, trajectory)
        self._found: dict[CheckFunction, Check | NotChecked | None] = {}
        self._parts = [Examination(part.problem, part.of(trajectory), is_part=True) for part in problem.parts]

    @cached_property
    def certificate(self) -> Certificate:
        """Every check that applies, with its margin; see `certify`."""
        if self._parts:
            parts = [part.certificate for part in self._parts]
            return with_kept(merged(self._problem, parts, self._together), self._kept)
        told = MotionSamples(self._problem, self._trajectory, is_told=True)
        found = [self._told(check, told) for check in self._applicable]
        certificate = Certificate(
            tuple(check for check in found if isinstance(check, Check)),
            tuple(check.name for check in found if isinstance(check, NotChecked)),
        )
        return with_kept(certificate, self._kept)

    @cached_property
    def _kept(self) -> list[Check | NotChecked]:
        """The grip of each gripper that lets nothing go, beside one that does."""
        if self._is_part or not self._is_continuous:
            return []
        motions = {name: MotionSamples(each, self._trajectory) for name, each in self._problem.kept.items()}
        found = {name: grip.grip_acceleration(motion) for name, motion in motions.items()}
        return [
            replace(check, detail=f"of {name or 'the own gripper'}") if isinstance(check, Check) else check
            for name, check in found.items()
            if check is not None
        ]

    @property
    def _lost(self) -> list[Check]:
        """Of these the ones that do not hold."""
        return [check for check in self._kept if isinstance(check, Check) and not check.ok]

    @cached_property
    def _together(self) -> list[Check]:
        """The checks of several grippers together; those of each are its part's."""
        return together(self._problem, self._trajectory, [part._motion for part in self._parts])

    @property
    def failed_releases(self) -> list[tuple[Check, int]]:
        """The checks that do not hold, each with the sample of the release that it is of."""
        if not self._parts:
            return [(check, self._trajectory.release_index) for check in self.failures]
        last = self._trajectory.passed[max(part.release for part in self._problem.parts)]
        found = [(check, last) for check in (*self._together, *self._lost) if not check.ok]
        return found + [each for part in self._parts for each in part.failed_releases]

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that do not hold, as the certificate has them."""
        if self._parts:
            return self.certificate.failures
        results = (self._result(check) for check in self._applicable)
        return (*(result for result in results if isinstance(result, Check) and not result.ok), *self._lost)

    @cached_property
    def first_failure(self) -> Check | None:
        """The first failed check, None for a valid certificate; the release window's only where no other fails."""
        if self._parts:
            of_each = (part.first_failure for part in self._parts)
            failed = [*(check for check in of_each if check), *(check for check in self._together if not check.ok)]
            failed += self._lost
            return next(iter(sorted(failed, key=lambda check: check.name == "landing_window")), None)
        order = sorted(self._applicable, key=_turn)
        results = (self._result(check) for check in order)
        failed = (result for result in results if isinstance(result, Check) and not result.ok)
        return next(failed, None) or next(iter(self._lost), None)

    @property
    def _applicable(self) -> tuple[CheckFunction, ...]:
        return (*JOINT_CHECKS, *MOTION_CHECKS) if self._is_continuous else JOINT_CHECKS

    @property
    def _is_continuous(self) -> bool:
        """Whether the samples are one motion: the bounds of all but the joint checks rest on that."""
        continuity = self._result(joints.continuity)
        return not isinstance(continuity, Check) or continuity.ok

    def _result(self, check: CheckFunction) -> Check | NotChecked | None:
        if check not in self._found:
            self._found[check] = check(self._motion)
        return self._found[check]

    def _told(self, check: CheckFunction, told: MotionSamples) -> Check | NotChecked | None:
        """Returns the result of a check; of one that holds, with a bound as its value.

        What proves a bound decides, too: a check is decided apart only where no bound is proven.
        """
        found = self._found.get(check)
        if check in TOLD_BY_ITSELF or (isinstance(found, Check) and not found.ok):
            return self._result(check)
        bound = check(told)
        if not isinstance(bound, Check) or bound.ok:
            return bound
        result = self._result(check)
        if not isinstance(result, Check) or not result.ok:
            return result
        return replace(result, value=result.limit, margin=0.0)


def _turn(check: CheckFunction) -> int:
    """Returns the sort key of a check in the search for one that fails; those of equal key keep their order."""
    if check in MOST_TELLING:
        return MOST_TELLING.index(check) - len(MOST_TELLING)
    return int(check is LAST_CHECK)


def certify(problem: ThrowProblem, trajectory: Trajectory) -> Certificate:
    """Returns the certificate of `trajectory` as a solution of `problem`: every check that applies, with its margin.

    If the samples are not one continuous motion at the controller's sample rate, the certificate has the joint checks
    only: the bounds of the others rest on that.

    Raises:
        TypeError: the arguments are in the other order, or something else.
    """
    if not isinstance(problem, ThrowProblem) or not isinstance(trajectory, Trajectory):
        given = f"{type(problem).__name__} and {type(trajectory).__name__}"
        raise TypeError(f"a problem and a trajectory are certified, in this order, not {given}")
    return Examination(problem, trajectory).certificate
