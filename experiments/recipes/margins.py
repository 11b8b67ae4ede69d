"""Constraint tightening: optimal flights with a margin to the hoops' rims and to the floor.

A policy that imitates such a flight may deviate a little and still pass.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from flatgym import SCENARIOS
from flatgym.scenarios.reference import Reference, reference
from flatgym.scenarios.scenario import Hoop, Scenario
from flatgym.task.rollout import replay_to_goal
from optimal.batch import fewest_steps_many
from optimal.direct.shooting import WINDINGS
from optimal.discrete.fewest_steps import FewestSteps
from optimal.discrete.fixed_steps import solve_in_steps
from optimal.flights.trajectory import Trajectory

HOOP_MARGINS = {
    "hoop": 0.3, "high-hoop": 0.08, "slalom": 0.02, "loop": 0.03, "split-s": 0.02, "ladder": 0.08,
    "figure-eight": 0.02, "slalom-6": 0.03, "zigzag-12": 0.02,
}  # fmt: skip
"""By how much hoop diameters are reduced for planning [m], by scenario. A larger margin would cost steps."""
GUIDE_HOOPS = {"ground-6": (Hoop(3.0, 0.6, 1.0),)}
"""Hoops added for planning, by scenario. This one lies 10 cm above the floor, and costs no step."""
HOOP_SHARE = 0.5
"""Share of a hoop's free width that is used in planning sampled scenarios. It costs two steps."""
OWN_MARGIN = 0.05
"""By how much hoop diameters of a scenario of one's own are reduced for planning [m], but not below HOOP_SHARE."""


def with_hoop_margin(scenario: Scenario, margin: float) -> Scenario:
    """Return a scenario whose hoop diameters are smaller by a margin [m]."""
    return scenario.with_diameters(hoop.diameter - margin for hoop in scenario.hoops)


def with_margins(scenario: Scenario) -> Scenario:
    """Return a scenario with the margins and guide hoops of its expert flight; one of one's own with OWN_MARGIN."""
    known = reference(scenario)
    if known is None:
        tightened = scenario.narrowed(HOOP_SHARE)
        pairs = zip(scenario.hoops, tightened.hoops, strict=True)
        return scenario.with_diameters(max(hoop.diameter - OWN_MARGIN, less.diameter) for hoop, less in pairs)
    tightened = with_hoop_margin(scenario, HOOP_MARGINS.get(known.scenario, 0.0))
    return replace(tightened, hoops=tightened.hoops + GUIDE_HOOPS.get(known.scenario, ()))


def robust_flight(scenario: Scenario, store: Path | None = None) -> FewestSteps:
    """Return the expert flight of a scenario, with margins; of a named one like the best known.

    `store` is a folder of flights that have been planned.
    """
    known = reference(scenario)
    windings = WINDINGS if known is None else (known.winding,)
    (planned,) = fewest_steps_many(
        [with_margins(scenario)], jobs=1, store=store, progress=False, windings=windings, time_budget=0.0
    )
    return replace(planned if known is None else near_best(planned, known), scenario=scenario)


def near_best(planned: FewestSteps, known: Reference) -> FewestSteps:
    """Return a flight in fewer steps than a planned one, planned again near the best known; else the planned one.

    On long tracks there are many local optima, and the search from nothing may miss the best.
    """
    target = planned.scenario
    states = replay_to_goal(SCENARIOS[known.scenario], known.actions)
    assert states is not None
    times, vehicle = target.dt * np.arange(len(states), dtype=np.float64), target.quadrotor
    best = Trajectory(times, states, vehicle.control(known.actions), vehicle)
    for count in range(known.k_star, len(planned.actions)):
        found = solve_in_steps(target, best, known.winding, count)
        if found is not None:
            return replace(planned, steps=len(found.actions), **found._asdict())
    return planned
