"""A proven lower bound of the number of environment steps.

The bound of the flight time also bounds the number of steps: controls that are held over a step are controls. A flight
in steps may end anywhere within the goal tolerance, and an environment rounds. The bound is therefore proven for a
relaxed scenario.
"""

from __future__ import annotations

from dataclasses import replace

from flatgym.scenarios.scenario import Scenario, Tolerance
from flatgym.task.transition import CONTACT_SLACK
from optimal.direct.shooting import ShootingSolution, solve_winding
from optimal.flights.projection_bound import projection_bound
from optimal.proof.lower_bound import GAP_STEP, MAX_GAP, TIME_BUDGET, Proof, Verdict, raise_bound, require_positive

ROUNDING_MARGIN = 1e-9
"""Margin by which a task is relaxed to include the rounding of an environment [m, m/s, rad]."""


def prove_steps(target: Scenario, shot: ShootingSolution, steps: int, time_budget: float = TIME_BUDGET) -> Proof:
    """Prove a lower bound of the time to reach the goal tolerance of an environment, close to a known number of steps.

    The bound does not use that controls are held over a step: it holds for any flight that arrives within the
    tolerance. Gaps, heights and tolerance are relaxed by ROUNDING_MARGIN, which includes the rounding of the
    environment.

    Args:
        target: the task.
        shot: its fastest direct solution.
        steps: the fewest steps known.
        time_budget: wall time after which the proof stops [s].
    """
    require_positive(MAX_GAP, time_budget)
    relaxed, one_less = relaxed_scenario(target), (steps - 1) * target.dt
    # A flight with free switching times that needs one step less limits what can be proven.
    free = solve_winding(relaxed, shot.winding, tolerant=True)
    faster = free.converged and free.trajectory.duration <= one_less * (1 + ROUNDING_MARGIN)
    last = free.trajectory.duration / (1 + MAX_GAP) if faster else one_less
    simple, fewer, times = projection_bound(relaxed, relaxed.tolerance), 1 + GAP_STEP, [last]
    while (less := (steps - fewer) * target.dt) > simple:
        if less < last:
            times.insert(0, less)
        fewer = 1 + GAP_STEP * (fewer - 1)
    gaps = [*(steps * target.dt / value - 1 for value in times[:-1]), MAX_GAP]
    durations = [(value * (1 + ROUNDING_MARGIN), gap) for value, gap in zip(times, gaps, strict=True)]
    proof = raise_bound(relaxed, shot, relaxed.tolerance, durations, time_budget, steps * target.dt)
    return replace(proof, verdict=Verdict.ONE_STEP_SHORT) if faster and proof.verdict is Verdict.CLOSED else proof


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
