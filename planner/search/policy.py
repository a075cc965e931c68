"""The search policy of `auto` and `casadi`: a table of stages in order.

Ruckig gives the soonest motion to a candidate within each joint's own limits, in microseconds, but disregards whatever
couples the joints; the certificate decides. The optimiser takes a hundred times longer, regards every limit, and moves
the release where the request leaves it free. So:

1. A given release state is tried with Ruckig's soonest motions. If nothing couples the joints, no motion is sooner.
   Where none of them is certified, slower motions to it are tried (`tighter`).
2. The optimiser starts from the first candidates of two aspects, until one motion is certified. A target or a point is
   then optimised from every other aspect that may allow a sooner one, and from one or two candidates of the answer's
   own aspect that are least like the answer: to a target from a second only where the search was short or long, from a
   given point from one where it was short. An answer whose stages do not fit it, or with a release window, is solved
   again, from itself.
3. Ruckig's motions that would release before the incumbent are certified, too, unless that is an optimised throw to
   a target with a release window.
4. While that has given no answer, further candidates are tried by both; of a given release state those of least lower
   bound in any case, however blocked the straight way there.
5. Ruckig's other motions to a given release state are tried under tighter limits, too. A doubtful search is repeated
   under tighter limits, and where nothing was optimised and the joints are free with torque held from the beginning
   (`tighter`). The slower second solver is tried at last.

Counts alone decide what is tried, so that the answer does not depend on the load of the machine. The only clock is the
request's own deadline.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from planner.backends import ruckig_otg
from planner.problem import TargetRelease
from planner.search.incumbent import PlanningSearch
from planner.search.ranking import RANKED_MAX, SEEDS_AN_ASPECT, Ranking
from planner.seeds import ASPECTS

ASPECT_SEEDS = SEEDS_AN_ASPECT * ASPECTS  # candidates that there are in the order of the aspects
# [-] Iterations of a search after which one more motion of the answer's aspect is sought: few, as that takes little
# time, or many, as such answers are late more often. After still more it would add to the slowest searches.
FEW_ITERATIONS = 60
FEW_ITERATIONS_AT_POINT = 40
MANY_ITERATIONS = range(151, 301)
ANSWER_ITERATIONS = 400  # [-] the same after which the answer is not solved again
SEEDS_MAX = 5  # candidates that the last seeds are of, in the order of the ranking

Condition = Callable[[PlanningSearch, Ranking], bool]


def always(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns True."""
    return True


def release_state_given(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether the joint states at the release are given, for one instant alone."""
    return search.problem.fixes_joints and not search.problem.is_robust


def no_incumbent(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether there is no certified motion yet."""
    return search.incumbent is None


def has_incumbent(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether there is a certified motion."""
    return search.incumbent is not None


def none_optimised(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether the optimiser came to no motion yet that is certified, or no sooner than one that is."""
    return not search.has_optimised


def other_aspects_pay(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether other aspects may pay: no optimised motion is certified, the release is not given, or in doubt.

    Of 160 points 9 were released sooner from another aspect, by up to a quarter. `Ranking.may_be_sooner` names those.
    """
    return further_seeds_pay(search, ranking) or not search.problem.fixes_joints


def further_seeds_pay(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether further seeds may pay: no optimised motion is certified, or a throw to a target, or in doubt."""
    of_target = isinstance(search.problem.release, TargetRelease)
    return none_optimised(search, ranking) or of_target or search.given_up > 0


def has_optimised_answer(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether this search came to an optimised motion itself, whose release is free."""
    is_own = has_incumbent(search, ranking) and not search.needs_sooner
    return is_own and search.has_optimised and not search.problem.fixes_joints


def another_throw_pays(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether the answer is a throw to a target, optimised.

    Of 600 a seventh release later by over a hundredth than the best that is known, by up to a half; those that took
    long to find more often than others. Two more seeds take away two fifths of that.
    """
    return has_optimised_answer(search, ranking) and isinstance(search.problem.release, TargetRelease)


def another_motion_pays(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether the answer is optimised, its release free, and was found in few iterations; to a target, or many.

    Of targets 3.2 % are sooner then by over a hundredth after few, 4.4 % after many, 1.4 % of those between; of robust
    throws 0, 3.0 and 1.8 %. Of points 5.8 % are after few; after more, the tries would use up the time allowed.
    """
    if isinstance(search.problem.release, TargetRelease):
        is_of_use = search.iterations <= FEW_ITERATIONS or search.iterations in MANY_ITERATIONS
    else:
        is_of_use = search.iterations <= FEW_ITERATIONS_AT_POINT
    return has_optimised_answer(search, ranking) and is_of_use


def answer_again_pays(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether the optimiser may come to a sooner motion from its own answer: its stages may not fit it.

    Of 133 such targets and points 19 are sooner then, 11 by over a hundredth; of 1,448 others 75, 22 by over a
    hundredth. With a release window 17 of 719 whose stages fit are sooner, too, 12 by over a hundredth, up to a third.
    """
    found = search.incumbent if has_optimised_answer(search, ranking) else None
    if found is None or found.backend != "casadi" or search.iterations > ANSWER_ITERATIONS:
        return False
    return search.problem.is_robust or not found.solution.stages_fit


def ruckig_pays(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether Ruckig's motion may be sooner. Of 600 such throws to a target, optimised, it never was."""
    return not (search.problem.is_robust and another_throw_pays(search, ranking))


def ruckig_sooner_pays(search: PlanningSearch, ranking: Ranking) -> bool:
    """Returns whether Ruckig's motion may be sooner than the certified one that there is."""
    return has_incumbent(search, ranking) and ruckig_pays(search, ranking)


@dataclass(frozen=True)
class Stage:
    """One row of the search policy: a back end tries candidates in order while a condition holds.

    Attributes:
        backend: "ruckig" certifies its motions to the candidates, "casadi" optimises from them.
        purpose: what the stage is for, in the attempt log.
        candidates: rows of the ranking; what was tried from one of them before is not tried again.
        condition: checked before every candidate.
        iterations: solver iterations after which the stage ends ("casadi"), without a release window.
        with_ipopt: whether IPOPT solves where fatrop gives up ("casadi").
        then_in_hand: whether Ruckig's motions are taken in hand after it, also past the deadline ("casadi").
        variants: launch variants that are tried ("ruckig").
        order: of the ranking; "arrival" takes the `TIMED_MAX` of least bound by the slowest joint's own time, "aspect"
            the first of every aspect, "bound" those of least lower bound, however blocked the way there, "unlike"
            those of the incumbent's aspect that were not tried, the one whose velocity is least like its own first,
            "answer" the incumbent's own release, with its motion.
        leaves_doubt: whether a seed that leads to no motion may be reason to repeat the search ("casadi").
        rounds: solves from one seed at most, each but the first after the failed checks of the one before ("casadi").
        guess: what the optimiser begins from where the release is free and no release window is asked for: the
            candidate's own motion, a gentle one, or to a target a gentle one first, then its own. Elsewhere it begins
            from its own ("casadi").
    """

    backend: Literal["casadi", "ruckig"]
    purpose: str
    candidates: slice
    condition: Condition
    iterations: int = 0
    with_ipopt: bool = False
    then_in_hand: bool = False
    variants: Sequence[ruckig_otg.LaunchVariant] = ruckig_otg.VARIANTS
    order: Literal["rank", "arrival", "aspect", "bound", "unlike", "answer"] = "rank"
    leaves_doubt: bool = True
    rounds: int = 4
    guess: Literal["own", "gentle", "gentle first"] = "own"


SOONEST_ARRIVALS = Stage(
    "ruckig", "soonest arrivals", slice(0, 2), release_state_given, variants=("free",), order="arrival"
)
# Of 1000 random requests, larger budgets of iterations answer one more, and take longer to refuse.
FIRST_SEEDS = Stage(
    "casadi",
    "soonest seeds",
    slice(0, 2),
    none_optimised,
    iterations=300,
    then_in_hand=True,
    order="aspect",
    guess="gentle first",
)
UNLIKE = "unlike the answer"
UNLIKE_ANSWER = tuple(
    Stage("casadi", UNLIKE, slice(0, 1), condition, iterations=100, order="unlike", leaves_doubt=False, guess="gentle")
    for condition in (another_throw_pays, another_motion_pays)
)
FROM_ANSWER = "the answer again"
ANSWER_AGAIN = Stage(
    "casadi", FROM_ANSWER, slice(0, 1), answer_again_pays, iterations=100, order="answer", leaves_doubt=False, rounds=1
)
POLICY: tuple[Stage, ...] = (
    SOONEST_ARRIVALS,
    FIRST_SEEDS,
    Stage("casadi", "other aspects", slice(0, ASPECT_SEEDS), other_aspects_pay, iterations=300, order="aspect"),
    *UNLIKE_ANSWER,
    ANSWER_AGAIN,
    Stage("ruckig", "sooner motions", slice(0, 6), ruckig_pays),
    Stage("casadi", "one more seed", slice(0, 3), further_seeds_pay, iterations=200),
    Stage("casadi", "least bounds", slice(0, 2), release_state_given, iterations=200, order="bound"),
    Stage("casadi", "last seeds", slice(0, SEEDS_MAX), none_optimised, iterations=100),
    Stage("ruckig", "further motions", slice(6, 11), ruckig_pays),
    Stage("ruckig", "sooner motions", slice(11, RANKED_MAX), ruckig_sooner_pays),
)
# From the release states of plans for other targets, which are much alike.
SHORT_POLICY: tuple[Stage, ...] = tuple(stage for stage in POLICY if stage.purpose not in {UNLIKE, FROM_ANSWER})
FIRST_SEEDS_POLICY: tuple[Stage, ...] = (FIRST_SEEDS,)  # of what may be offered instead of a refused request
# Of a doubtful search once more, with other limits or rows, for what is sooner: where there is no answer yet, or a slow
# one with a release window. Without further seeds of the same aspects 38 late answers were as soon, and a search in
# vain took two thirds of the time.
FURTHER = {UNLIKE, FROM_ANSWER, "one more seed", "last seeds", "further motions"}
AGAIN_POLICY: tuple[Stage, ...] = tuple(stage for stage in POLICY if stage.purpose not in FURTHER)
# Before that in each of those ways: two thirds of what is found sooner comes from the first seeds, in two fifths of the
# time.
FIRST_AGAIN_POLICY: tuple[Stage, ...] = (
    SOONEST_ARRIVALS,
    Stage("casadi", "soonest seeds", slice(0, 2), always, iterations=300, order="aspect"),
    *UNLIKE_ANSWER,
    ANSWER_AGAIN,
)
# Under several pairs of tighter limits, by Ruckig alone: other curves, past what stands around.
SLOWER_POLICY: tuple[Stage, ...] = (SOONEST_ARRIVALS,)
# The same after the optimiser, by every variant.
SOONER_POLICY: tuple[Stage, ...] = (Stage("ruckig", "sooner motions", slice(0, 2), has_incumbent),)
# From the motions without a release window, where the search found none with it.
FROM_NOMINAL_POLICY: tuple[Stage, ...] = (
    Stage("casadi", "from motions without the window", slice(0, 3), no_incumbent, iterations=300, order="bound"),
)
LAST_POLICY: tuple[Stage, ...] = (
    Stage("casadi", "second solver", slice(0, 1), no_incumbent, iterations=200, with_ipopt=True),
)
