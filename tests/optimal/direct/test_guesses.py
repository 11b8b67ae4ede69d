"""Guesses along given stations: dynamics and stations hold, and the flight they are taken from is found again."""

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Scenario
from optimal.direct.guesses import guess_along
from optimal.direct.program import coarse_steps
from optimal.direct.shooting import solve_along, solve_winding
from optimal.direct.stages import Stages

SHORT = Scenario("short", (0, 0), (1, 2), hoops=(Hoop(3.0, 1.0, 0.6, 1.2), Hoop(2.0, 4.0, 0.8, 2.6)))


def plan_of(scenario, shot, samples=61):
    """Return passing times, sampled tilts and places in the gaps of a flight."""
    flight, ends = shot.trajectory, np.cumsum(shot.steps)
    tilts = flight.state(np.linspace(0.0, flight.duration, samples))[:, 4]
    places = [(flight.states[k, :2] - hoop.centre) @ hoop.across for k, hoop in zip(ends, scenario.hoops, strict=False)]
    return flight.breakpoints[ends], tilts, places


@pytest.mark.parametrize("name", ["horizontal-6", "climb", "ground-6", "hoop", "high-hoop", "slalom", "loop"])
@pytest.mark.parametrize("winding", [0, 1])
def test_the_plan_of_a_flight_leads_back_to_it(name, winding):
    scenario = SCENARIOS[name]
    shot = solve_winding(scenario, winding)
    times, tilts, places = plan_of(scenario, shot)
    for known in (places, None):
        found = solve_along(scenario, times, tilts, places=known)
        assert found.converged
        assert found.winding == winding
        assert found.trajectory.duration == pytest.approx(shot.trajectory.duration, rel=1e-4)


def test_the_guess_passes_the_stations_and_ends_at_rest():
    times, tilts, places = np.array([0.8, 1.5, 2.4]), np.sin(np.linspace(0.0, 7.0, 30)), np.array([0.1, -0.2])
    steps = coarse_steps(SHORT)
    stages = Stages(steps)
    states = guess_along(SHORT, steps, times, tilts, places)[stages.states]
    np.testing.assert_allclose(states[0], SHORT.start_state, atol=1e-12)
    for k, hoop, place in zip(np.cumsum(steps), SHORT.hoops, places, strict=False):
        np.testing.assert_allclose(states[k, :2], hoop.centre + place * hoop.across, atol=1e-9)
    np.testing.assert_allclose(states[-1, :2], SHORT.goal, atol=1e-9)
    np.testing.assert_allclose(states[-1, 2:4], 0.0, atol=1e-9)
    assert states[-1, 4] == pytest.approx(tilts[-1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"passing_times": [0.5, 1.0]}, "must be 3 times"),
        ({"passing_times": [0.5, 0.5, 1.0]}, "increase from 0"),
        ({"passing_times": [0.0, 0.5, 1.0]}, "increase from 0"),
        ({"passing_times": [0.5, float("nan"), 1.0]}, "increase from 0"),
        ({"tilts": [0.0]}, "at least two angles"),
        ({"places": [0.0]}, "must be 2 distances"),
    ],
)
def test_a_plan_that_does_not_fit_the_scenario_is_rejected(change, message):
    plan = {"passing_times": [0.5, 1.0, 1.5], "tilts": [0.0, 0.0], "places": [0.0, 0.0]} | change
    with pytest.raises(ValueError, match=message):
        solve_along(SHORT, **plan)
