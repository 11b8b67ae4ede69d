"""Analytic policy gradients: what the tensors fly and see is what the environment flies and shows."""

import numpy as np
import pytest
import torch

from agents.advice import hoops_along, regulated, seen_along
from agents.analytic import AnalyticConfig, Clip, Course, deviation, follow, observe
from agents.evaluate import fly
from agents.experts import Expert
from agents.imitation import DaggerConfig, Keeper, clone, student
from flatgym import SCENARIOS
from flatgym.reference import reference
from flatgym.scene import Scene
from optimal import fewest_steps


@pytest.fixture(scope="module")
def flights():
    return [fewest_steps(name, windings=(reference(name).winding,), time_budget=0.0) for name in ("ground-6", "hoop")]


def test_tensors_see_what_the_environment_shows(flights):
    course = Course.of(flights)
    for i, flight in enumerate(flights):
        shown = seen_along(flight.scenario, flight.states, flight.actions).observations
        for k in (0, 30, len(shown) - 1):
            state = torch.as_tensor(np.tile(flight.states[k], (2, 1)), dtype=torch.float32)
            passed = torch.tensor([hoops_along(flight.scenario, flight.states, flight.actions)[k]] * 2)
            np.testing.assert_allclose(observe(course, state, passed, k)[i].numpy(), shown[k], atol=2e-6)


def test_a_flight_costs_what_the_environments_flight_is_away(flights):
    for flight in flights:
        model = student(DaggerConfig(scenario=flight.scenario.name, width=16, depth=1))
        torch.nn.init.constant_(model.policy.action_net.bias, 0.3)
        scene = Scene.of([flight.scenario])
        course = Course.of([flight])
        start = torch.as_tensor(flight.states[:1], dtype=torch.float32)
        cost = deviation(model, course, scene, start).item()
        flown = fly(model, flight.scenario).states[0][: len(flight.actions) + 1]
        scale = np.array([0.1, 0.1, 0.2, 0.2, 0.1])
        off = np.square((flown - course.states[0, : len(flown)].numpy()) / scale).sum(axis=1)
        assert len(flown) < len(flight.actions) + 1 or cost == pytest.approx(
            float(off @ course.weights[0, : len(flown)].numpy()), rel=1e-2
        )


def test_the_derivative_is_that_of_the_cost(flights):
    flight = flights[1]
    model = student(DaggerConfig(scenario="hoop", width=8, depth=1, zoom=1.0))
    course, scene = Course.of([flight]), Scene.of([flight.scenario])
    start = torch.as_tensor(flight.states[:1], dtype=torch.float32)
    bias = model.policy.action_net.bias
    torch.nn.init.constant_(bias, 0.1)
    (slope,) = torch.autograd.grad(deviation(model, course, scene, start).sum(), bias)
    for i in range(2):
        costs = []
        for push in (1e-3, -1e-3):
            with torch.no_grad():
                bias[i] += push
                costs.append(deviation(model, course, scene, start).item())
                bias[i] -= push
        assert (costs[0] - costs[1]) / 2e-3 == pytest.approx(float(slope[i]), rel=0.05)


def test_the_clip_keeps_only_derivatives_that_lead_back_inside():
    value = torch.tensor([0.5, 1.5, 1.5, -1.5, -1.5], requires_grad=True)
    Clip.apply(value).backward(torch.tensor([1.0, 1.0, -1.0, 1.0, -1.0]))
    # A descent step goes against the derivative: at 1.5 a positive one leads back.
    assert value.grad.tolist() == [1.0, 1.0, 0.0, 0.0, -1.0]


def test_the_weights_stand_at_goal_and_hoops(flights):
    course = Course.of(flights)
    for i, flight in enumerate(flights):
        heavy = np.flatnonzero(course.weights[i].numpy() == 1.0)
        assert heavy[-1] == flight.steps
        assert len(heavy) == 1 + 2 * len(flight.scenario.hoops)
        assert (course.weights[i, flight.steps + 1 :] == 0).all()
    assert course.rows(torch.tensor([1])).goal.tolist() == [[5.0, 5.0]]


def test_following_brings_a_clone_closer():
    scenario = SCENARIOS["horizontal-3"]
    flight = fewest_steps(scenario, windings=(0,), time_budget=0.0)
    config = DaggerConfig(scenario="horizontal-3", width=32, depth=2, updates=800, batch=256)
    model = clone(regulated(Expert(flight), scenario, scatter=0.2, noise=0.2)(None, 0), config)
    course, scene = Course.of([flight]), Scene.of([scenario])
    start = torch.zeros(1, 5)
    before = deviation(model, course, scene, start).item()
    asked = AnalyticConfig(scenario="horizontal-3", updates=20, check_every=10, batch=4, learning_rate=1e-4)
    keeper = Keeper(asked)
    follow(model, [flight], asked, keeper)
    assert len(keeper.curve) == 2
    assert keeper.env_steps == 20 * 4 * flight.steps
    assert deviation(model, course, scene, start).item() < before
