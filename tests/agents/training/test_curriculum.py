"""Curriculum: tolerance, start states, and the expert's flight as start states."""

from dataclasses import replace

import numpy as np
import pytest

from agents.training.configs import TOLERANCE_SHARE, PPOConfig
from agents.training.curriculum import NEAREST_SHARE, Curriculum, TrainingReward, curriculum, expert_flight
from agents.training.vec_env import make_vec_env
from flatgym import SCENARIOS, Hoop, Scenario, scenario
from flatgym.envs.compiled_fleet import CompiledFleet
from flatgym.envs.config import EnvConfig, Starts
from flatgym.envs.numpy_fleet import NumpyFleet
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.scenarios.reference import reference
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import Scene
from flatgym.task.shaping import potential

DEMONSTRATED = PPOConfig(scenario="slalom", pool_expert_share=0.5)


@pytest.mark.parametrize(
    ("problem", "passed", "price"),
    [("horizontal-3", 0, 0.5), ("slalom", 0, 1.5), ("slalom", 2, 0.5), ("slalom", 3, 0.5)],
)
def test_failure_costs_as_much_as_hoops_are_ahead(problem, passed, price):
    start = Starts(SCENARIOS[problem].start_state[None], np.array([passed]), 1.0)
    envs = TrainingReward(make_vec_env(problem, 4, starts=start, seed=0), 0.5)
    envs.reset()
    ended = []
    for _ in range(250):
        _, rewards, dones, infos = envs.step(np.tile(np.array([1.0, 0.05], np.float32), (4, 1)))
        ended += [(info["outcome"], reward) for info, reward, done in zip(infos, rewards, dones, strict=True) if done]
    assert {"out-of-bounds"} == {outcome for outcome, _ in ended}
    assert {-price} == {float(reward) for _, reward in ended}


def test_the_hoops_ahead_are_those_of_the_episode_that_failed():
    envs = TrainingReward(make_vec_env("random-hoops", 64, seed=0), 0.5)
    envs.reset()
    (fleet,), costs = set(envs.get_attr("fleet")), []
    while len(costs) < 200:
        hoops = fleet.hoop_counts()
        _, rewards, dones, infos = envs.step(np.tile(np.array([1.0, 0.05], np.float32), (64, 1)))
        for i in np.flatnonzero(dones):
            costs.append(-rewards[i])
            assert rewards[i] == -0.5 * max(1, hoops[i] - infos[i]["hoops_passed"])
    assert set(costs) == {0.5, 1.0, 1.5}


@pytest.mark.parametrize("name", SCENARIOS)
def test_from_no_state_of_the_best_flight_failing_returns_more_than_flying_on(name):
    """The condition under which the training reward has the optimum of the environment, see TrainingReward."""
    problem, best = SCENARIOS[name], reference(name)
    scene, price = Scene.of([problem]), PPOConfig().failure_cost
    for k, episode in enumerate(fly_actions(problem, best.actions)[:-1]):
        to_go, ahead = (best.k_star - k) * problem.dt, len(problem.hoops) - episode.hoops_passed[0]
        assert to_go + potential(scene, episode)[0] < price * max(1, ahead)


@pytest.mark.parametrize("name", ["hoop", "slalom"])
def test_the_return_of_a_failure_is_that_of_its_last_state_and_its_hoops(name):
    problem, scene = SCENARIOS[name], Scene.of([SCENARIOS[name]])
    best = reference(name).actions
    for share in (0.25, 0.75):
        actions = np.concatenate([best[: int(share * len(best))], np.tile(np.array([1.0, 0.0], np.float32), (250, 1))])
        flown = fly_actions(problem, actions)
        k, last = len(flown) - 2, flown[-2]
        envs = TrainingReward(make_vec_env(name, 1, seed=0), 0.5)
        envs.reset()
        returned = sum(float(envs.step(action[None])[1][0]) for action in actions[: k + 1])
        risen = float(potential(scene, last)[0] - potential(scene, flown[0])[0])
        cost = 0.5 * max(1, len(problem.hoops) - last.hoops_passed[0])
        assert returned == pytest.approx(-k * problem.dt + risen - cost, abs=1e-4)


@pytest.mark.parametrize(("name", "flown"), [("climb", 1), ("drop", -1), ("hoop", 0)])
@pytest.mark.parametrize("turns", [None, -1, 0, 1])
def test_only_a_flight_with_the_turns_succeeds(name, flown, turns):
    envs = TrainingReward(make_vec_env(name, 1, seed=0), 0.5, turns)
    envs.reset()
    for action in reference(name).actions:
        _, rewards, dones, infos = envs.step(action.astype(np.float32)[None])
    assert dones[0]
    assert infos[0]["outcome"] == "goal"
    assert (rewards[0] == -0.5) == (turns not in (None, flown))


@pytest.mark.parametrize(("name", "turns"), [("climb", 1), ("drop", -1)])
def test_the_return_of_a_flight_with_turns_counts_the_time_to_turn_once(name, turns):
    problem, actions = SCENARIOS[name], reference(name).actions
    returns = []
    for wanted in (None, turns):
        envs = TrainingReward(make_vec_env(name, 1, seed=0), 0.5, wanted)
        envs.reset()
        returns.append(sum(float(envs.step(action[None])[1][0]) for action in actions))
    assert returns[1] - returns[0] == pytest.approx(2 * np.pi / problem.quadrotor.rate_max, abs=1e-4)
    episode = fly_actions(problem, actions)[0]
    shaped = -len(actions) * problem.dt - potential(Scene.of([problem]), episode)[0]
    assert returns[0] == pytest.approx(float(shaped), abs=1e-4)


def test_at_the_time_limit_the_time_to_turn_changes_by_the_turning_alone():
    shorter = replace(SCENARIOS["climb"], time_limit=0.2)
    sums = []
    for turns in (None, 1):
        envs = TrainingReward(make_vec_env(shorter, 1, seed=0), 0.5, turns)
        envs.reset()
        steps = [envs.step(np.array([[0.0, 1.0]], np.float32)) for _ in range(shorter.max_steps)]
        assert steps[-1][2][0]
        assert steps[-1][3][0]["outcome"] == "time-limit"
        sums.append(sum(float(rewards[0]) for _, rewards, _, _ in steps))
    assert sums[1] - sums[0] == pytest.approx(shorter.time_limit, abs=1e-5)  # all of it at the greatest rate


def test_flights_with_turns_start_so_that_the_simulated_ones_end_with_them():
    pools = [Curriculum(PPOConfig(scenario="climb", turns=turns)).pool for turns in (None, 0, 2)]
    inside = (pools[0].state != SCENARIOS["climb"].start_state).any(axis=1)
    np.testing.assert_array_equal(pools[0].state, pools[1].state)
    np.testing.assert_allclose((pools[2].state - pools[0].state)[inside, 4], 4 * np.pi, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(pools[2].state[:, :4], pools[0].state[:, :4])


@pytest.mark.parametrize("problem", ["hoop", "random-goal"])
def test_the_tolerance_tightens_to_the_true_one(problem):
    course = Curriculum(PPOConfig(scenario=problem, tolerance=3.0))
    seen = [course.tolerance(done) for done in np.linspace(0, 1, 21)]
    assert [tolerance.position for tolerance in seen] == sorted([t.position for t in seen], reverse=True)
    assert seen[0].position == pytest.approx(3 * course.problem.tolerance.position)
    assert {t for t, done in zip(seen, np.linspace(0, 1, 21), strict=True) if done >= TOLERANCE_SHARE} == {
        course.problem.tolerance
    }


def test_the_share_of_pool_starts_falls():
    course = Curriculum(PPOConfig())
    assert course.share(0.0) == course.share(TOLERANCE_SHARE) == 0.8
    assert course.share(1.0) == pytest.approx(0.1)


def test_a_distribution_has_no_pool_of_starts():
    course = Curriculum(PPOConfig(scenario="random-hoops", pool_expert_share=0.5))
    assert course.starts(0.5) is None


@pytest.mark.parametrize("name", ["hoop", "loop", "slalom"])
def test_the_remaining_actions_reach_the_goal_from_every_state_of_the_expert_flight(name):
    flight, actions = expert_flight(scenario(name)), reference(name).actions
    n = len(actions)
    envs = FlatQuadVectorEnv(n, name)
    envs.reset(options={"state": flight.state, "hoops_passed": flight.hoops_passed})
    ended = np.zeros(n, dtype=object)
    for k in range(n):
        # Vehicle i starts with action i; ended episodes are ignored.
        rows = np.minimum(np.arange(n) + k, n - 1)
        infos = envs.step(actions[rows])[4]
        last = np.arange(n) + k == n - 1
        ended[last] = infos["outcome"][last]
    assert set(ended) == {"goal"}


@pytest.mark.parametrize("done", [0.0, 0.2, TOLERANCE_SHARE, 1.0])
def test_expert_starts_extend_backwards_from_the_goal(done):
    course = Curriculum(DEMONSTRATED)
    flight, pool = course.flight, course.starts(done)
    rows = {tuple(state): i for i, state in enumerate(flight.state)}
    other = (pool.state != course.pool.state).any(axis=1)
    on_it = [rows[tuple(state)] for state in pool.state[other]]
    n, back = len(flight.state), NEAREST_SHARE + (1 - NEAREST_SHARE) * min(1.0, done / TOLERANCE_SHARE)
    assert len(on_it) / len(pool.state) == pytest.approx(0.5, abs=0.02)
    assert max(on_it) == n - 1
    assert min(on_it) == pytest.approx(n * (1 - back), abs=1.5)
    np.testing.assert_array_equal(course.starts(done).state, pool.state)


def test_the_solver_provides_the_expert_flight_of_an_unknown_scenario():
    near = Scenario("near", (0.0, 0.0), (1.0, 0.0), hoops=(Hoop(0.5, 0.0, 1.0),))
    flight = expert_flight(near)
    np.testing.assert_array_equal(flight.state[0], near.start_state)
    assert set(flight.hoops_passed) == {0, 1}


@pytest.mark.parametrize("kind", [NumpyFleet, CompiledFleet])
def test_a_fleet_samples_starts_from_a_replaced_pool(kind):
    problem = scenario("hoop")
    first = Starts(np.tile(problem.start_state, (3, 1)), np.zeros(3), 1.0)
    second = Starts(first.state + np.array([0.0, 1.0, 2.0, 0.0, 0.1]), np.ones(3), 1.0)
    fleet = kind(EnvConfig(problem, starts=first), 4)
    fleet.set_starts(second)
    _, record = fleet.reset(np.ones(4, dtype=bool))
    np.testing.assert_allclose(record.numbers[0:5].T, np.tile(second.state[0], (4, 1)))
    np.testing.assert_array_equal(record.counts[1], 1)


def test_the_curriculum_sets_the_environments():
    course = curriculum(DEMONSTRATED)
    envs = TrainingReward(make_vec_env("slalom", 8, starts=course.starts(0.0), seed=0), 0.5)
    envs.reset()
    course.apply(envs, 0.2)
    (fleet,) = set(envs.get_attr("fleet"))
    assert fleet.config.tolerance == course.tolerance(0.2)
    assert fleet.share == course.share(0.2)
    np.testing.assert_array_equal(fleet.config.starts.state, course.starts(0.2).state)
    assert curriculum(DEMONSTRATED) is course
