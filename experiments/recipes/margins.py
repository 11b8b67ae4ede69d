"""TODO experiments/recipes/margins.py."""

from __future__ import annotations

from dataclasses import replace

from flatgym.scenarios.reference import reference
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.discrete.fewest_steps import FewestSteps, fewest_steps

MARGINS = {"hoop": 0.3, "high-hoop": 0.08, "slalom": 0.02, "loop": 0.03}
"""How much narrower than they are the hoops are planned through [m]; more would cost steps, where there is little."""
GUIDES = {"ground-6": (Hoop(3.0, 0.6, 1.0),)}
"""Gaps to plan through besides; this one, 10 cm above the floor, costs no step and keeps off it."""
INNER = 0.5
"""The share of a drawn hoop's width that is planned through: it costs two steps, and a learner may err."""


def narrowed(scenario: Scenario, by: float) -> Scenario:
    """Return a scenario whose hoops are narrower by so much [m]."""
    return scenario.with_diameters(hoop.diameter - by for hoop in scenario.hoops)


def inner(scenario: Scenario, share: float) -> Scenario:
    """Return a scenario whose hoops are a share of their width, between which its vehicle has to fit."""
    least = 2 * scenario.quadrotor.radius
    return scenario.with_diameters(least + share * (hoop.diameter - least) for hoop in scenario.hoops)


def narrower(scenario: Scenario) -> Scenario:
    """Return a named scenario as its optimal flight is planned for a learner: clear of the rims and of the floor."""
    easier = narrowed(scenario, MARGINS.get(scenario.name, 0.0))
    return replace(easier, hoops=easier.hoops + GUIDES.get(scenario.name, ()))


def teacher(scenario: Scenario) -> FewestSteps:
    """Return the flight to learn: as the scenario's optimal one, but clear of the rims."""
    known = reference(scenario)
    assert known is not None
    return replace(fewest_steps(narrower(scenario), windings=(known.winding,), time_budget=0.0), scenario=scenario)
