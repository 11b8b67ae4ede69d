"""Broken flights: each violates its own field of the certificate, and only the true flight passes.

`broken` is a section of `experiments.measurements.solvers`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements.sections import Advance
from flatgym import SCENARIOS, Scenario
from optimal import Certificate, Trajectory, certify


def broken(_: bool, advance: Advance) -> list[Row]:
    """Does each kind of broken flight violate its own field of the certificate, and only the true one pass?"""
    names = ("true", *BREAKS)
    rows = []
    for i, name in enumerate(names):
        scenario = SCENARIOS["hoop"] if name == "hoop_clearance" else SCENARIOS["ground-6"]
        flight = optimal.solve(scenario, max_gap=None).trajectory
        assert isinstance(flight, Trajectory)
        certificate = certify(*BREAKS[name](flight, scenario)) if name != "true" else certify(flight, scenario)
        values = {field.name: getattr(certificate, field.name) for field in fields(Certificate)}
        rows.append(
            {"broken": name, "scenario": scenario.name, "field": values.get(name), "holds": certificate.holds()}
        )
        advance(i + 1, len(names))
    return rows


def _weaker_vehicle(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    weaker = replace(scenario.quadrotor, thrust_max=scenario.quadrotor.thrust_max * (1 - 1e-8))
    return flight, replace(scenario, quadrotor=weaker)


def _lower_ceiling(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    top = float(flight.state(np.linspace(0, flight.duration, 4001))[:, 1].max())
    return flight, replace(scenario, ceiling=top - 1e-6)


def _moved_state(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    states = flight.states.copy()
    states[len(states) // 2, 0] += 1e-5
    return replace(flight, states=states), scenario


def _faster_motion(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    return replace(flight, breakpoints=flight.breakpoints * 0.8), scenario


def _moved_goal(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    return flight, replace(scenario, goal=(scenario.goal[0] + 1e-5, scenario.goal[1]))


def _narrower_hoop(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    hoop = scenario.hoops[0]
    aside = float(certify(flight, scenario).hoop_clearance)
    return flight, scenario.with_diameters([hoop.diameter - 2 * (aside + 1e-6)])


BREAKS: dict[str, Callable[[Trajectory, Scenario], tuple[Trajectory, Scenario]]] = {
    "max_control_violation": _weaker_vehicle,
    "max_path_violation": _lower_ceiling,
    "replay_error": _moved_state,
    "gap": _faster_motion,
    "terminal_error": _moved_goal,
    "hoop_clearance": _narrower_hoop,
}
"""How to break a flight or to tighten its scenario, by the field of the certificate that must fail."""
