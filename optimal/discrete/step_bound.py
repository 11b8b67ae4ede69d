"""A proven lower bound of the number of environment steps.

Shorter flights than a number of steps are excluded first with controls that may change at any time, because controls
that are held over a step are controls too. One step less than the fewest known is excluded last, with controls that are
held (`zero_order_hold`). A flight in steps may end anywhere within the goal tolerance, and an environment
rounds. The bound is therefore proven for a relaxed scenario.
"""

from __future__ import annotations

from dataclasses import replace

from flatgym.scenarios.scenario import Scenario, Tolerance
from flatgym.task.transition import CONTACT_SLACK
from optimal.direct.shooting import ShootingSolution
from optimal.flights.projection_bound import projection_bound
from optimal.proof.lower_bound import MAX_GAP, TIME_BUDGET, Proof, gap_step, raise_bound, require_positive

ROUNDING_MARGIN = 1e-9
"""Margin by which a task is relaxed to include the rounding of an environment [m, m/s, rad]."""


def prove_steps(target: Scenario, shot: ShootingSolution, steps: int, time_budget: float = TIME_BUDGET) -> Proof:
    """Prove a lower bound of the time to reach the goal tolerance of an environment, close to a known number of steps.

    Gaps, heights and tolerance are relaxed by ROUNDING_MARGIN, which includes the rounding of the environment.

    Args:
        target: the task.
        shot: its fastest direct solution.
        steps: the fewest steps known.
        time_budget: wall time after which the proof stops [s].
    """
    require_positive(MAX_GAP, time_budget)
    relaxed, flown = relaxed_scenario(target), steps * target.dt
    simple, fewer, durations = projection_bound(relaxed, relaxed.tolerance), 2.0, list[tuple[float, float]]()
    while (time := (steps - fewer) * target.dt) > simple:
        durations.insert(0, (time * (1 + ROUNDING_MARGIN), flown / time - 1))
        fewer *= gap_step(target)
    return raise_bound(relaxed, shot, relaxed.tolerance, durations, time_budget, flown=flown, steps=steps - 1)


def least_steps(proof: Proof) -> int:
    """Return the fewest environment steps that a proof does not exclude."""
    # The quotient may be rounded across a whole number. The product is the time of the environment.
    steps = round(proof.time / proof.scenario.dt)
    return steps + 1 if steps * proof.scenario.dt <= proof.time else steps


def relaxed_scenario(target: Scenario) -> Scenario:
    """Return a scenario with gaps, heights and tolerance relaxed by ROUNDING_MARGIN.

    Heights are also relaxed by the contact slack of the environment.
    """
    margin, near, depth = ROUNDING_MARGIN, target.tolerance, CONTACT_SLACK + ROUNDING_MARGIN
    return replace(
        target.with_diameters(hoop.diameter + 2 * margin for hoop in target.hoops),
        floor=None if target.floor is None else target.floor - depth,
        ceiling=None if target.ceiling is None else target.ceiling + depth,
        tolerance=Tolerance(near.position + margin, near.speed + margin, near.angle + margin),
    )
