"""The projection bound is valid and has its closed forms; hoops are passed within their windows."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario, Tolerance
from optimal.direct.shooting import solve_coarse, solve_winding
from optimal.flights.projection_bound import passing_windows, projection_bound


def test_the_paper_printed_an_impossible_time():
    # The literature agrees on 1.4 s; the paper's 1.289 s is below the bound of thrust alone.
    assert projection_bound(SCENARIOS["diagonal"]) == pytest.approx(1.2911, abs=1e-4)
    assert projection_bound(SCENARIOS["diagonal"]) > 1.289


def test_the_bound_is_below_every_flight_time(generator):
    for _ in range(6):
        goal = generator.uniform(-8, 8, 2)
        scenario = Scenario("somewhere", (0, 0), tuple(goal))
        flown = min(solve_winding(scenario, winding).trajectory.duration for winding in (0, 1, -1))
        assert projection_bound(scenario, Tolerance()) < projection_bound(scenario) < flown


def test_the_bound_is_proportional_to_the_square_root_of_the_distance():
    near, far = (projection_bound(Scenario("d", (0, 0), (d, d))) for d in (1.0, 4.0))
    assert far == pytest.approx(2 * near, rel=1e-12)


def test_a_larger_tolerance_lowers_the_bound():
    bounds = [projection_bound(SCENARIOS["hoop"], Tolerance(p, s)) for p, s in ((0.1, 0.2), (0.1, 2.0), (1.0, 2.0))]
    assert bounds[0] > bounds[1] > bounds[2] > 0
    tiny = projection_bound(SCENARIOS["hoop"], Tolerance(1e-9, 1e-9))
    assert tiny == pytest.approx(projection_bound(SCENARIOS["hoop"]), rel=1e-6)


def test_no_displacement_takes_no_time():
    assert projection_bound(SCENARIOS["horizontal-3"], Tolerance(position=5.0)) == 0.0
    assert np.isfinite(projection_bound(SCENARIOS["drop"]))


@pytest.mark.parametrize("name", ["hoop", "high-hoop", "slalom", "loop"])
@pytest.mark.parametrize("tolerant", [False, True])
def test_hoops_are_passed_within_their_windows(name, tolerant):
    scenario = SCENARIOS[name]
    tolerance = scenario.tolerance if tolerant else None
    shots = [solve_coarse(scenario, winding, tolerant=tolerant) for winding in (0, -1)]
    flown = [shot for shot in shots if shot.converged]
    assert flown
    for shot in flown:
        duration = shot.trajectory.duration
        times = shot.trajectory.breakpoints[np.cumsum(shot.steps)[:-1]]
        # A flight that hovers before or after is longer, and the windows of longer flights are wider.
        for before, after in ((0.0, 0.0), (0.4, 0.0), (0.0, 0.4)):
            shares = (times + before) / (duration + before + after)
            for longest in (duration + before + after, 1.5 * (duration + 0.4)):
                windows = np.array(passing_windows(scenario, longest, tolerance))
                assert (windows[:, 0] < shares).all()
                assert (shares < windows[:, 1]).all()


@pytest.mark.parametrize("name", ["hoop", "high-hoop", "slalom", "loop"])
def test_windows_widen_with_duration_gap_and_tolerance(name):
    scenario = SCENARIOS[name]
    hoops = tuple(replace(hoop, diameter=hoop.diameter + 0.2) for hoop in scenario.hoops)
    body = replace(scenario, quadrotor=Quadrotor(radius=0.1))
    short, long, wide, narrow, near = (
        np.array(passing_windows(*arguments))
        for arguments in (
            (scenario, 2.0),
            (scenario, 3.0),
            (replace(scenario, hoops=hoops), 2.0),
            (body, 2.0),
            (scenario, 2.0, Tolerance()),
        )
    )
    for inner, outer in ((short, long), (short, wide), (narrow, short)):
        assert (outer[:, 0] < inner[:, 0]).all()
        assert (inner[:, 1] < outer[:, 1]).all()
    assert (near[:, 0] == short[:, 0]).all()
    assert (near[:, 1] > short[:, 1]).all()
    for windows in (short, long):
        assert (np.diff(windows, axis=0) >= 0).all()  # hoops are passed in order


def test_without_gravity_windows_have_a_closed_form():
    free = Quadrotor(thrust_min=0.0, thrust_max=16.0, gravity=0.0)
    scenario = Scenario("free", (0, 0), (10, 0), (Hoop(2.2, 0, 0.4), Hoop(6.2, 0, 0.4)), quadrotor=free)
    # 2 m and 6 m from rest at 16 m/s^2; 7.6 m and 3.6 m to rest.
    (a, b), (c, d) = passing_windows(scenario, 2.0)
    assert (a, c) == pytest.approx((0.25, math.sqrt(0.75) / 2), rel=1e-6)
    assert (b, d) == pytest.approx((1 - math.sqrt(0.95) / 2, 1 - math.sqrt(0.45) / 2), rel=1e-6)
    # Arrival at up to 2 m/s: v t - 8 t^2 covers the remaining distance less the tolerance.
    left = 1 - passing_windows(scenario, 2.0, Tolerance(0.1, 2.0))[1][1]
    assert 2.0 * (2 * left) + 8 * (2 * left) ** 2 == pytest.approx(3.5, rel=1e-6)


def test_a_mirrored_scenario_has_the_same_windows():
    scenario = SCENARIOS["slalom"]
    hoops = tuple(replace(hoop, x=-hoop.x, angle=math.pi - hoop.angle) for hoop in scenario.hoops)
    there = replace(scenario, goal=(-scenario.goal[0], scenario.goal[1]), hoops=hoops)
    np.testing.assert_allclose(passing_windows(there, 3.0), passing_windows(scenario, 3.0), rtol=1e-12)
    assert passing_windows(SCENARIOS["climb"], 1.3) == []
