"""Constraint tightening: robust flights take K* steps and keep their margins."""

from dataclasses import replace

import pytest

from experiments.recipes.margins import (
    HOOP_MARGINS,
    HOOP_SHARE,
    OWN_MARGIN,
    robust_flight,
    with_hoop_margin,
    with_margins,
)
from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.scenarios.reference import reference
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import GOAL


@pytest.mark.parametrize("name", ["hoop", "high-hoop"])
def test_a_robust_flight_takes_k_star_steps_and_clears_the_rims(name):
    scenario = SCENARIOS[name]
    flight = robust_flight(scenario)
    assert flight.scenario == scenario
    assert flight.steps == reference(name).k_star
    assert with_margins(scenario) == with_hoop_margin(scenario, HOOP_MARGINS[name])
    for tightened in (scenario, with_margins(scenario)):
        assert fly_actions(tightened, flight.actions)[-1].outcome[0] == GOAL


def test_a_share_of_the_free_width_leaves_room_for_the_vehicle():
    scenario = DISTRIBUTIONS["random-hoops"].scenario(0)
    radius = scenario.quadrotor.radius
    for hoop, narrow in zip(scenario.hoops, scenario.narrowed(HOOP_SHARE).hoops, strict=True):
        assert narrow.diameter - 2 * radius == pytest.approx(HOOP_SHARE * (hoop.diameter - 2 * radius))


def test_margins_are_found_by_content_and_not_by_name():
    hoop = SCENARIOS["hoop"]
    assert with_margins(replace(hoop, name="mine")).hoops == with_margins(hoop).hoops
    other = replace(hoop.with_diameters([0.2]), goal=(5.0, 4.0))  # called hoop, whose margin is wider than this gap
    assert with_margins(other) == with_hoop_margin(other, OWN_MARGIN)
    assert with_margins(other.with_diameters([0.06])) == other.with_diameters([0.06]).narrowed(HOOP_SHARE)
    flight = robust_flight(other)
    for tightened in (other, with_margins(other)):
        assert fly_actions(tightened, flight.actions)[-1].outcome[0] == GOAL
