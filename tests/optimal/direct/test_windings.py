"""Pruned windings: never the fastest, but most of the others; the recursion bounds every sampled tilt."""

import numpy as np
import pytest

from experiments.measurements.sections import uniform_goal
from flatgym import SCENARIOS
from optimal.direct.multistart import search
from optimal.direct.shooting import WINDINGS, solve_coarse
from optimal.direct.windings import ANGLES, greatest_integrals, pruned_windings, sliding_maximum


@pytest.mark.parametrize("number", range(4))
def test_no_winding_is_pruned_at_a_time_that_it_reaches(number):
    goal = uniform_goal(np.random.default_rng((3, number)), number)
    shots = {winding: solve_coarse(goal, winding) for winding in (0, 1, -1)}
    for shot in shots.values():
        for winding, other in shots.items():
            # The errors of the coarse grid and of the sums are well below this factor.
            assert not pruned_windings(goal, shot, other.trajectory.duration * 1.003, {winding})


@pytest.mark.parametrize("name", ["climb", "horizontal-6"])
def test_pruning_keeps_the_fastest_flight(name):
    alone = {winding: search(SCENARIOS[name], windings=(winding,), starts=2).shots for winding in (0, 1, -1, 2)}
    fastest = min(shots[0].trajectory.duration for shots in alone.values() if shots)
    assert search(SCENARIOS[name]).shots[0].trajectory.duration == pytest.approx(fastest, rel=1e-6)


def test_most_windings_are_pruned():
    shot = solve_coarse(SCENARIOS["horizontal-6"])
    assert pruned_windings(SCENARIOS["horizontal-6"], shot, shot.trajectory.duration * 1.003, set(WINDINGS)) == set(
        WINDINGS
    ) - {0}


def test_with_hoops_no_winding_is_pruned():
    shot = solve_coarse(SCENARIOS["hoop"])
    assert pruned_windings(SCENARIOS["hoop"], shot, 0.1, WINDINGS) == set()


def test_the_recursion_bounds_every_tilt_within_the_rate(generator):
    target, time = SCENARIOS["diagonal"], 1.3
    start, slope = generator.normal(size=2), generator.normal(size=2)
    values = greatest_integrals(target, start, slope, time, 1)
    t = np.linspace(0.0, time, 4001)
    q, quadrotor = start + slope * t[:, None], target.quadrotor
    for winding in (0, 1, -1):
        for bend in generator.uniform(-1.5, 1.5, 20):
            theta = 2 * np.pi * winding * t / time + bend * np.sin(2 * np.pi * t / time)
            if np.abs(np.gradient(theta, t)).max() > quadrotor.rate_max:
                continue
            lift = q[:, 0] * np.sin(theta) + q[:, 1] * np.cos(theta)
            reward = np.maximum(quadrotor.thrust_max * lift, quadrotor.thrust_min * lift) - quadrotor.gravity * q[:, 1]
            scale = quadrotor.thrust_max * np.hypot(*q.T).max() * time
            assert np.trapezoid(reward, t) <= values[len(values) // 2 + winding * ANGLES] + 2e-3 * scale


def test_the_sliding_maximum(generator):
    values = generator.normal(size=40)
    expected = [values[i : i + 2 * 6 + 1].max() for i in range(40 - 12)]
    np.testing.assert_array_equal(sliding_maximum(values, 6), expected)
    np.testing.assert_array_equal(sliding_maximum(values, 0), values)
