"""Imitation recipes: planned flights, the episodes' own experts, and the count of env steps and expert labels."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from agents.controllers.tracking import OpenLoop, TrackingControllers
from agents.evaluation.rollouts import fly
from agents.imitation.cloning import untrained_policy
from agents.imitation.dataset_aggregation import DaggerConfig
from agents.policies.categorical import BinnedDistribution
from experiments.files import write_json
from experiments.recipes import run_spec
from experiments.recipes.baselines import PolicyPerVehicle
from experiments.recipes.imitation import BINS, bins_of, oracle_for
from experiments.recipes.margins import robust_flight
from experiments.recipes.plans import plan_flights
from experiments.recipes.registry import LEARNERS
from experiments.recipes.run_spec import RunSpec
from flatgym import DISTRIBUTIONS, SCENARIOS, task
from flatgym.scenarios.reference import EVALUATION_SEED, drawn_k_star
from flatgym.task.scene import FLYING, GOAL, Scene

BUDGET = replace(run_spec.SMOKE, demonstrations=3)


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    """A run on random goals whose flights are planned in this process."""
    folder = tmp_path_factory.mktemp("run")
    for first, count in ((0, BUDGET.demonstrations), (EVALUATION_SEED, BUDGET.disturbed_episodes)):
        write_json(folder / f"planned-random-goal-{first}-{first + count}.json", {"planning_s": 1.5})
    return RunSpec("random-goal", 0, folder, BUDGET)


def test_each_vehicle_flies_its_own_flight(spec):
    flights, seconds = plan_flights(spec, EVALUATION_SEED, BUDGET.disturbed_episodes)
    assert seconds == 1.5
    policy = PolicyPerVehicle([OpenLoop(flight) for flight in flights])
    flown = fly(policy, "random-goal", len(flights), EVALUATION_SEED)
    k_star = drawn_k_star("random-goal", EVALUATION_SEED + np.arange(len(flights))).k_star
    assert flown.outcomes == ("goal",) * len(flights)
    assert flown.steps.tolist() == k_star.tolist()


@pytest.mark.parametrize("problem", ["hoop", "random-goal"])
def test_env_steps_and_expert_labels_are_counted(spec, problem):
    oracle, _ = oracle_for(replace(spec, problem=problem), 2)
    data = oracle(None, 0)
    mirrors = 2 if problem == "random-goal" else 1
    assert mirrors * oracle.expert_labels == len(data.actions)
    assert oracle.env_steps == 0
    policy = untrained_policy(DaggerConfig(scenario=problem, width=8, depth=1))
    before, data = oracle.expert_labels, oracle(policy, 1)
    if problem == "random-goal":
        replans, distribution = BUDGET.round_replans, DISTRIBUTIONS[problem]
        alone = fly(policy, distribution, replans, replans % (BUDGET.demonstrations - replans)).steps.sum()
        assert alone < oracle.env_steps <= alone + BUDGET.round_rollouts * distribution.max_steps
        assert 0 < 2 * (oracle.expert_labels - before) < len(data.actions)  # mirrored, and plans count repeatedly
    else:
        assert oracle.env_steps >= oracle.expert_labels - before == len(data.actions)
    assert (oracle.env_steps, oracle.expert_labels - before) == (data.env_steps, data.labels)


@pytest.mark.parametrize("agent", ["bc-categorical", "dagger-categorical"])
def test_categorical_recipes_train_a_categorical_actor(tmp_path, agent):
    trained = LEARNERS[agent](RunSpec("horizontal-3", 0, tmp_path, BUDGET))
    assert trained.policy.policy.bins == trained.configs[0].bins == BINS


def flown_rounded(scenario):
    """Return the outcome of the LQR around the expert flight with actions rounded to BINS."""
    controllers, levels = TrackingControllers([robust_flight(scenario)]), BinnedDistribution(BINS)
    scene, first, point = Scene.of([scenario]), np.zeros(1, dtype=int), np.full(1, -1)
    episode = task.initial(scene)
    while episode.outcome[0] == FLYING:
        point, off, _ = controllers.nearest(first, episode.state, point)
        rounded = levels.levels(levels.numbers(torch.from_numpy(controllers.action(first, point, off)))).numpy()
        episode = task.advance(scene, episode, scenario.quadrotor.control(rounded))
    return episode.outcome[0]


@pytest.mark.parametrize("name", ["slalom", "split-s", "figure-eight", "ladder"])
def test_the_actor_of_a_track_has_bins_if_the_expert_flies_with_actions_rounded_to_them(name):
    assert (bins_of(SCENARIOS[name]) is not None) == (flown_rounded(SCENARIOS[name]) == GOAL)


@pytest.mark.parametrize("problem", [SCENARIOS["hoop"], DISTRIBUTIONS["random-track"]])
def test_other_actors_are_fitted_by_the_squared_error(problem):
    assert bins_of(problem) is None
