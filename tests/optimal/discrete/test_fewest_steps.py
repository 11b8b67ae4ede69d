"""K*: actions reach the goal at exactly K steps in both environments, and no wider search finds fewer steps."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario, Tolerance, task
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.task.scene import GOAL
from optimal import SolveFailed, Status, fewest_steps
from optimal.direct.shooting import solve_coarse, solve_winding
from optimal.discrete.fewest_steps import expected_duration

INDEPENDENT = {"horizontal-3": 44, "horizontal-6": 61, "horizontal-15": 94, "diagonal": 70}
"""K* of an independent search with a square tolerance; the round tolerance may need one step more."""


@pytest.mark.parametrize("name", ["horizontal-6", "hoop", "ground-6", "climb", "slalom"])
def test_actions_replay_to_the_goal_at_exactly_k_steps(name):
    many_hoops = name == "slalom"  # the proof takes too long for a test
    result = fewest_steps(name, time_budget=0.0 if many_hoops else 30.0)
    assert result.actions.dtype == np.float32
    assert result.actions.shape == (result.steps, 2)
    assert result.lower_bound <= result.steps
    assert result.proven == (not many_hoops)
    assert result.status is (Status.BEST_KNOWN if many_hoops else Status.PROVEN)
    assert result.tolerance_used < 1
    env, envs = gym.make("FlatQuad-v0", scenario=name), FlatQuadVectorEnv(2, scenario=name)
    env.reset()
    envs.reset()
    for k, action in enumerate(result.actions, start=1):
        _, _, terminated, truncated, info = env.step(action)
        batch = envs.step(np.stack([action, action]))
        assert (terminated, truncated) == (k == result.steps, False)
        np.testing.assert_allclose(info["state"], result.states[k], atol=1e-12)
        np.testing.assert_array_equal(batch[2], [terminated] * 2)
    assert info["is_success"]
    assert info["hoops_passed"] == len(SCENARIOS[name].hoops)


@pytest.mark.parametrize(("name", "steps"), INDEPENDENT.items())
def test_k_agrees_with_an_independent_search(name, steps):
    assert fewest_steps(name, windings=(0,)).steps in (steps, steps + 1)


def test_k_decreases_with_the_tolerance_and_increases_with_the_distance():
    scenario = SCENARIOS["horizontal-3"]
    tight, loose = (
        fewest_steps(replace(scenario, tolerance=Tolerance(p, 2 * p, p)), windings=(0,)).steps for p in (0.02, 0.3)
    )
    usual = fewest_steps(scenario, windings=(0,)).steps
    assert loose < usual < tight
    assert fewest_steps("horizontal-6", windings=(0,)).steps > usual


def test_shorter_steps_are_not_slower():
    scenario = SCENARIOS["horizontal-3"]
    coarse = fewest_steps(replace(scenario, dt=0.04), windings=(0,))
    fine = fewest_steps(replace(scenario, dt=0.02), windings=(0,))
    assert fine.steps * 0.02 <= coarse.steps * 0.04


def test_a_missing_flight_is_reported_with_the_expected_time():
    hurried = replace(SCENARIOS["horizontal-6"], time_limit=1.1)
    with pytest.raises(SolveFailed, match=r"no flight was found.*takes about 1.201 s of 1.1 s") as failure:
        fewest_steps(hurried, windings=(0,))
    assert failure.value.problem == hurried
    result = fewest_steps(hurried, windings=(0,), raise_on_failure=False)
    assert result.steps == math.inf
    assert result.actions.shape == (0, 2)


def test_hoops_close_together_are_crossed_within_their_steps():
    scenario = replace(SCENARIOS["hoop"], hoops=(Hoop(2.4, 2.4, 0.5), Hoop(2.5, 2.5, 0.5)))
    result = fewest_steps(scenario, windings=(0,))
    assert result.steps >= fewest_steps("diagonal", windings=(0,)).steps


KNOWN = {
    "horizontal-3": 44,
    "horizontal-6": 61,
    "horizontal-9": 74,
    "horizontal-12": 84,
    "horizontal-15": 94,
    "ground-6": 61,
    "diagonal": 70,
    "hoop": 70,
    "climb": 64,
    "drop": 64,
    "high-hoop": 75,
    "slalom": 145,
    "loop": 136,
}
"""Best-known K*, from this search and from a general solver in place of the staged one."""


@pytest.mark.parametrize("name", [name for name in KNOWN if name not in ("slalom", "loop", "high-hoop")])
def test_no_more_steps_than_the_best_known(name):
    assert fewest_steps(name).steps <= KNOWN[name]


@pytest.mark.parametrize("winding", [0, 1, -1])
def test_the_tolerance_saves_what_the_costates_predict(winding):
    target = SCENARIOS["diagonal"]
    rough = solve_coarse(target, winding)
    tolerant = solve_winding(target, winding, tolerant=True).trajectory.duration
    assert expected_duration(target, rough) == pytest.approx(tolerant, rel=0.01)
    assert tolerant < rough.trajectory.duration - 0.01


def test_a_body_keeps_clear_of_the_rims():
    body = replace(SCENARIOS["hoop"], quadrotor=Quadrotor(radius=0.1))
    result = fewest_steps(body, windings=(0,))
    assert task.fly_actions(body, result.actions)[-1].outcome[0] == GOAL
    assert result.steps >= fewest_steps("hoop", windings=(0,)).steps


def test_a_body_passes_two_narrow_hoops():
    # The first flight found touches a rim between two constrained points.
    hoops = (Hoop(0.0, -3.376, 0.6, -2.131), Hoop(-2.49, -4.794, 0.6, -2.067))
    target = Scenario("narrow", (0, 0), (-3.293, -6.83), hoops=hoops, quadrotor=Quadrotor(radius=0.1))
    result = fewest_steps(target, windings=(1,))
    assert task.fly_actions(target, result.actions)[-1].outcome[0] == GOAL
    assert result.steps <= 90


def test_a_time_limit_below_the_bound_is_infeasible():
    hurried = replace(SCENARIOS["horizontal-6"], time_limit=1.0)
    result = fewest_steps(hurried, windings=(0,), raise_on_failure=False)
    assert result.status is Status.INFEASIBLE
    assert "at least 54 steps of 0.02 s, and time_limit = 1.0 s allows 50" in result.reason
