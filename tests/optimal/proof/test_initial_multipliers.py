"""The costates of a flight, as multipliers, prove its near-optimality within its branch in one evaluation."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS
from optimal.direct.shooting import solve_winding
from optimal.proof.branches import Branch
from optimal.proof.dual import Dual
from optimal.proof.initial_multipliers import KINKS, active_heights, kink_shares, multipliers
from optimal.proof.programme.stations import Problem
from optimal.proof.programme.time_grid import angles_for, time_grid
from tests.optimal.proof.passing import known

LOW = replace(SCENARIOS["horizontal-6"], ceiling=0.05)
FLOWN = {name: (SCENARIOS[name], 0) for name in ("horizontal-6", "diagonal", "ground-6", "hoop")} | {
    "low": (LOW, 0),
    "climb": (SCENARIOS["climb"], 1),
    "high-hoop": (SCENARIOS["high-hoop"], 1),
}


@cache
def shot(name):
    found = solve_winding(*FLOWN[name])
    assert found.converged
    return found


def proves(name: str, gap: float, width: float = 0.0) -> bool:
    """Return whether the costates exclude flights of the same winding that are faster by more than a gap."""
    (scenario, winding), flown = FLOWN[name], shot(name)
    kinks = kink_shares(scenario, flown)
    grid = time_grid(flown.trajectory.duration / (1 + gap), scenario.quadrotor.rate_max, turn=angles_for(abs(gap)))
    passing = flown.trajectory.breakpoints[np.cumsum(flown.steps)[:-1]]
    problem = Problem(scenario, None, grid.time, kinks)
    windows = [(time - width, time + width) for time in passing]
    cut = Dual(problem, grid, Branch(winding), problem.hoops, known(windows))(multipliers(scenario, flown, kinks))
    return cut.value + cut.rounding < 0


@pytest.mark.parametrize("name", ["horizontal-6", "diagonal", "ground-6", "low"])
def test_costates_prove_their_own_winding_in_one_evaluation(name):
    assert proves(name, 5e-4)
    assert not proves(name, -5e-4)


@pytest.mark.parametrize("name", ["hoop", "high-hoop"])
def test_costates_prove_it_through_a_hoop_for_passing_times_near_their_own(name):
    assert proves(name, 1e-2, 0.01)
    assert proves(name, 2e-3, 0.005)
    assert not proves(name, -2e-3, 0.01)


@pytest.mark.parametrize("name", FLOWN)
def test_the_weight_is_the_costate_of_velocity_throughout(name):
    (scenario, _), flown = FLOWN[name], shot(name)
    kinks = kink_shares(scenario, flown)
    y = multipliers(scenario, flown, kinks)
    share = flown.trajectory.breakpoints[1:] / flown.trajectory.duration
    passing = [0.0, *share[np.cumsum(flown.steps)[:-1] - 1], 1.0]
    stations = y[: 2 * len(passing)].reshape(-1, 2)
    weight = np.stack([np.interp(share, passing, stations[:, i]) for i in (0, 1)], axis=1)
    sign = -1 if scenario.floor is None else 1
    for at, strength in zip(kinks, y[stations.size : -2], strict=True):
        weight[:, 1] += sign * strength * np.maximum(share - at, 0)
    # Floor and ceiling act on control points of an arc's cubic, a third of a step away from its ends.
    near = 1e-2 if kinks else 1e-6
    np.testing.assert_allclose(weight, flown.costates[:, 2:4], atol=near * np.abs(flown.costates[:, 2:4]).max())


@pytest.mark.parametrize("name", FLOWN)
def test_signs_are_those_required_by_the_dual(name):
    (scenario, winding), flown = FLOWN[name], shot(name)
    kinks = kink_shares(scenario, flown)
    y = multipliers(scenario, flown, kinks)
    problem, grid = Problem(scenario, None, flown.trajectory.duration, kinks), time_grid(2.0, 10.0)
    dual = Dual(problem, grid, Branch(winding), problem.hoops, known([(0.5, 0.6)] * len(scenario.hoops)))
    assert y.shape == (dual.size,)
    assert (y[dual.signed] >= 0).all()
    assert (y[-2:] > 0).all()


def test_active_heights_are_where_the_flight_touches_them():
    for name, height in (("ground-6", 0.0), ("low", 0.05)):
        flown = shot(name)
        active = active_heights(flown) != 0
        assert active.any()
        np.testing.assert_allclose(flown.trajectory.states[1:][active, 1], height, atol=1e-4)
        shares = kink_shares(FLOWN[name][0], flown)
        assert {*KINKS} < {*shares}
        assert list(shares) == sorted(shares)
        assert 0 < shares[0] < shares[-1] < 1
    for name in ("horizontal-6", "climb", "hoop", "high-hoop"):
        assert not active_heights(shot(name)).any()
        assert kink_shares(FLOWN[name][0], shot(name)) == ()


def test_jumps_are_assigned_to_the_nearest_kink_and_none_is_lost():
    (scenario, _), flown = FLOWN["ground-6"], shot("ground-6")
    fine, coarse = (multipliers(scenario, flown, kinks) for kinks in (kink_shares(scenario, flown), KINKS))
    assert coarse[4:-2].sum() == pytest.approx(fine[4:-2].sum(), rel=1e-12)
    # An inactive ceiling has kinks of zero strength.
    roof = replace(scenario, ceiling=50.0)
    both = multipliers(roof, flown, KINKS)
    assert both.shape == (len(coarse) + len(KINKS),)
    assert (both[4 + len(KINKS) : -2] == 0).all()
