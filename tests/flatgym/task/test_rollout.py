"""Open-loop rollouts: all steps at once give the states and outcomes of step-by-step simulation."""

import numpy as np
import pytest

from flatgym import SCENARIOS
from flatgym.scenarios.reference import reference
from flatgym.task.rollout import episode_outcomes, fly_actions, open_loop_states, replay_to_goal
from flatgym.task.scene import FLOOR, GOAL


def assert_rollouts_agree(scenario, actions):
    """Compare `open_loop_states` and `episode_outcomes` with `fly_actions`; return the episode states of the latter."""
    episode = fly_actions(scenario, actions)
    steps = len(episode) - 1
    states = open_loop_states(scenario, actions)
    after = episode_outcomes(scenario, states, actions)
    np.testing.assert_allclose(states[: steps + 1], [e.state[0] for e in episode], atol=1e-12)
    np.testing.assert_array_equal(after.outcome[:steps], [e.outcome[0] for e in episode[1:]])
    np.testing.assert_array_equal(after.hoops_passed[:steps], [e.hoops_passed[0] for e in episode[1:]])
    return episode


@pytest.mark.parametrize("name", ["ground-6", "hoop", "slalom", "loop"])
def test_optimal_actions_reach_the_goal_in_every_rollout(name, generator):
    scenario, actions = SCENARIOS[name], reference(name).actions
    episode = assert_rollouts_agree(scenario, actions)
    assert episode[-1].outcome[0] == GOAL
    states = replay_to_goal(scenario, actions)
    np.testing.assert_allclose(states, [e.state[0] for e in episode], atol=1e-12)
    assert replay_to_goal(scenario, actions[:-1]) is None
    longer = np.append(actions, generator.uniform(-1, 1, (5, 2)).astype(np.float32), axis=0)
    np.testing.assert_array_equal(replay_to_goal(scenario, longer), states)


def test_a_rollout_that_touches_the_floor_does_not_reach_the_goal():
    scenario, actions = SCENARIOS["ground-6"], reference("ground-6").actions.copy()
    actions[3:, 0] = -1
    assert assert_rollouts_agree(scenario, actions)[-1].outcome[0] == FLOOR
    assert replay_to_goal(scenario, actions) is None


@pytest.mark.parametrize("name", ["hoop", "slalom", "loop"])
def test_perturbed_actions_give_the_same_outcomes(name, generator):
    scenario, actions = SCENARIOS[name], reference(name).actions
    for scale in (0.01, 0.1, 1.0):
        assert_rollouts_agree(scenario, np.clip(actions + generator.normal(0, scale, actions.shape), -1, 1))


def test_a_rollout_may_start_in_the_middle_of_an_episode():
    scenario, actions = SCENARIOS["slalom"], reference("slalom").actions
    episode = fly_actions(scenario, actions)
    first = next(k for k, e in enumerate(episode) if e.hoops_passed[0] == 2)
    rest = replay_to_goal(scenario, actions[first:], episode[first].state[0], hoops_passed=2)
    np.testing.assert_allclose(rest, [e.state[0] for e in episode[first:]], atol=1e-12)
    assert replay_to_goal(scenario, actions[first:], episode[first].state[0], hoops_passed=0) is None
