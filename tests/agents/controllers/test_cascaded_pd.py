"""Cascaded PD: reaches every named scenario and most sampled ones; batched equals single; mirror symmetry."""

from dataclasses import replace

import numpy as np
import pytest

from agents.controllers.cascaded_pd import CascadedPD
from agents.evaluation.bootstrap import iqm
from agents.evaluation.rollouts import fly
from agents.evaluation.scores import episode_rows
from flatgym import DISTRIBUTIONS, SCENARIOS, Quadrotor
from flatgym.task.observation import observe
from flatgym.task.scene import Scene
from flatgym.task.transition import initial


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_named_scenario_is_reached_without_a_flip(name):
    flights = fly(CascadedPD(), name)
    assert flights.outcomes == ("goal",)
    assert np.abs(flights.states[0][:, 4]).max() < np.pi / 2


@pytest.mark.parametrize(("name", "most"), [("random-goal", 0.4), ("random-hoops", 0.65)])
def test_sampled_scenarios_are_reached(name, most):
    rows = episode_rows(CascadedPD(), name, episodes=200)
    assert (rows["outcome"] == "goal").mean() >= 0.99
    assert 0.2 < iqm(rows["gap"]) < most


def situations(name, generator, n=50):
    scene = Scene.of([SCENARIOS[name]]).repeat(n)
    state = generator.normal(size=(n, 5)) * [4, 4, 3, 3, 0.5]
    passed = generator.integers(0, len(SCENARIOS[name].hoops) + 1, n)
    return scene, replace(initial(scene), state=state, hoops_passed=passed)


@pytest.mark.parametrize("name", ["slalom", "ground-6"])
def test_batched_actions_equal_single_ones(name, generator):
    observations = observe(*situations(name, generator))
    actions, state = CascadedPD().predict(
        observations, state="kept", episode_start=np.ones(50, bool), deterministic=True
    )
    assert (actions.shape, actions.dtype, state) == ((50, 2), np.float32, "kept")
    assert np.all(np.abs(actions) <= 1)
    for one, action in zip(observations, actions, strict=True):
        np.testing.assert_array_equal(CascadedPD().predict(one)[0], action)


def test_a_mirrored_scene_gives_mirrored_actions(generator):
    scene, there = situations("slalom", generator)
    mirror = np.array([-1.0, 1.0])
    mirrored = replace(
        scene,
        goal=scene.goal * mirror,
        hoop_centre=scene.hoop_centre * mirror,
        hoop_direction=scene.hoop_direction * mirror,
    )
    state = there.state * [-1, 1, -1, 1, -1]
    actions = CascadedPD().predict(observe(scene, there))[0]
    again = CascadedPD().predict(observe(mirrored, replace(there, state=state)))[0]
    np.testing.assert_allclose(again, actions * [1, -1], atol=1e-5)


def test_at_the_goal_it_hovers():
    scene = Scene.of([SCENARIOS["diagonal"]])
    arrived = replace(initial(scene), state=SCENARIOS["diagonal"].goal_state[None])
    action = CascadedPD().predict(observe(scene, arrived))[0]
    np.testing.assert_allclose(Quadrotor().control(action), [[9.81, 0.0]], atol=1e-5)


def test_another_vehicle_reaches_the_goal():
    lazy = Quadrotor(thrust_min=5.0, thrust_max=15.0, rate_max=6.0, gravity=8.0)
    heavier = replace(DISTRIBUTIONS["random-goal"], name="lazy", quadrotor=lazy)
    flights = fly(CascadedPD(lazy, braking=3.0, turning=12.0, damping=5.0, approach=2.0), heavier, episodes=20)
    assert flights.outcomes.count("goal") >= 19
