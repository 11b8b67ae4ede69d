"""Environment configuration: validation by name, and the step limits."""

from dataclasses import replace

import numpy as np
import pytest

from flatgym import DISTRIBUTIONS, SCENARIOS, Quadrotor, Tolerance
from flatgym.envs.config import STATE_MOST, EnvConfig, Starts, check_states
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.scenarios.scenario import STEPS_MOST

HOOP, HOOPS = SCENARIOS["hoop"], DISTRIBUTIONS["random-hoops"]
REST = np.zeros((3, 5))


def test_a_config_has_the_properties_of_its_problem():
    vehicle, tolerance = Quadrotor(rate_max=5.0), Tolerance(0.2)
    for problem in (HOOP, HOOPS):
        config = EnvConfig(replace(problem, quadrotor=vehicle, tolerance=tolerance, dt=0.01))
        assert (config.quadrotor, config.tolerance, config.dt) == (vehicle, tolerance, 0.01)
        assert config.last_step == config.problem.max_steps == 500
    assert (EnvConfig(HOOP).hoops_most, EnvConfig(HOOPS).hoops_most) == (1, 3)
    assert (EnvConfig(HOOP).shaped, EnvConfig(HOOP, "sparse").shaped) == (True, False)


@pytest.mark.parametrize("most", [1, 249, 250, 251, STEPS_MOST, np.int64(7)])
def test_the_last_step_is_the_earlier_of_both_limits(most):
    assert EnvConfig(HOOP, steps_most=most).last_step == min(most, HOOP.max_steps)


def test_max_episode_steps_changes_neither_reward_nor_observed_time(generator):
    long, short = (FlatQuadVectorEnv(4, HOOP, "sparse", max_episode_steps=most) for most in (None, 5))
    for envs in (long, short):
        envs.reset(seed=0)
    for i in range(5):
        actions = generator.uniform(-1, 1, (4, 2))
        one, other = long.step(actions), short.step(actions)
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])
        assert not one[3].any()
        assert other[3].all() == (i == 4)


def test_a_goal_in_the_last_step_is_not_a_truncation():
    # Gymnasium's TimeLimit, which cannot look inside, sets both flags there.
    envs = FlatQuadVectorEnv(1, "diagonal", max_episode_steps=1)
    envs.reset(options={"state": [5, 5, 0, 0, 0]})
    _, _, terminated, truncated, infos = envs.step(envs.scenario.quadrotor.action([[9.81, 0.0]]))
    assert (terminated[0], truncated[0], infos["outcome"][0]) == (True, False, "goal")


def test_starts_are_floats_with_no_hoop_passed_by_default():
    starts = Starts([[0, 0, 0, 0, 0], [1, 2, 3, 4, 5]])
    assert starts.state.dtype == np.float64
    assert starts.hoops_passed.tolist() == [0, 0]
    assert Starts(REST, [0.0, 1.0, 1.0]).hoops_passed.tolist() == [0, 1, 1]


def test_starts_are_a_copy():
    state = REST.copy()
    starts = Starts(state)
    state += 1
    assert not starts.state.any()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: EnvConfig(HOOP, "dense"), "unknown reward 'dense'; known: shaped, sparse"),
        (lambda: EnvConfig(HOOP, ["sparse"]), r"unknown reward \['sparse'\]"),
        (lambda: EnvConfig(HOOP, observation="pixels"), "unknown observation 'pixels'; known: features, state"),
        (lambda: EnvConfig(HOOP, observation=["state"]), r"unknown observation \['state'\]"),
        (lambda: EnvConfig(HOOP, steps_most=0), r"max_episode_steps must be a whole number in 1\.\.1000000, got 0"),
        (lambda: EnvConfig(HOOP, steps_most=2.5), "max_episode_steps must be a whole number"),
        (lambda: EnvConfig(HOOP, steps_most=True), "max_episode_steps must be a whole number"),
        (lambda: EnvConfig(HOOP, starts=REST), r"starts must be a flatgym\.envs\.config\.Starts or None"),
        (
            lambda: EnvConfig(HOOPS, starts=Starts(REST)),
            "starts belong to a scenario, not to the distribution 'random-h",
        ),
        (lambda: EnvConfig(HOOP, starts=Starts(REST, [0, 1, 2])), "hoops_passed must not exceed the 1 hoops.*got 2"),
        (lambda: Starts(np.zeros(5)), r"Starts\.state must have shape \(m, 5\) with m >= 1, got \(5,\)"),
        (lambda: Starts(np.zeros((0, 5))), r"Starts\.state must have shape \(m, 5\) with m >= 1, got \(0, 5\)"),
        (lambda: Starts(np.zeros((3, 4))), r"Starts\.state must be five finite numbers"),
        (lambda: Starts(REST + np.nan), r"Starts\.state must be five finite numbers"),
        (lambda: Starts("north"), r"Starts\.state must be an array of numbers, got 'north'"),
        (lambda: Starts([[0, 0], [0]]), r"Starts\.state must be an array of numbers"),
        (lambda: Starts(REST, [0, 1]), r"Starts\.hoops_passed must be whole numbers >= 0 of shape \(3,\)"),
        (lambda: Starts(REST, [0, 0.5, 1]), r"Starts\.hoops_passed must be whole numbers"),
        (lambda: Starts(REST, [0, -1, 1]), r"Starts\.hoops_passed must be whole numbers"),
        (lambda: Starts(REST, [0, 1e300, 1]), r"Starts\.hoops_passed must be whole numbers"),
        (lambda: Starts(REST, share=1.1), r"Starts\.share must lie in \[0, 1\], got 1\.1"),
        (lambda: Starts(REST, share="all"), r"Starts\.share must be a number, got 'all'"),
    ],
)
def test_invalid_configs_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_start_states_are_bounded_and_have_the_right_shape():
    assert check_states([STATE_MOST] * 5, (), "here").tolist() == [STATE_MOST] * 5
    for wrong in ([2 * STATE_MOST] * 5, [0] * 4, [[0] * 5], "state", None, [10**400] * 5):
        with pytest.raises(ValueError, match="here must be"):
            check_states(wrong, (), "here")
    with pytest.raises(ValueError, match=r"here must be five finite numbers .* for each vehicle"):
        check_states(np.zeros((2, 5)), (3,), "here")
