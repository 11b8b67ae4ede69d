"""Expert data along trajectories: observations on a flight, plans from visited states, and flights reversed in time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controllers.mpc import replans_along
from agents.imitation.dataset import ExpertData, concatenate
from flatgym import task
from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance
from flatgym.task.rollout import episode_outcomes
from flatgym.task.scene import EpisodeState, Integers, Scene
from optimal.discrete.fewest_steps import FewestSteps

PLAN_TOLERANCE = 0.5
"""Share of the goal tolerance that plans may use. It costs at most one step and leaves a margin for policy errors."""


def plan_labels(flight: FewestSteps, states: Array, actions: NDArray[np.float32], every: int, steps: int) -> ExpertData:
    """Return the labels of plans to the goal from the states of another flight after its last hoop.

    Args:
        flight: the optimal flight of the scenario.
        states: states of the other flight, shape (K+1, 5).
        actions: actions of the other flight, shape (K, 2).
        every: steps between plans.
        steps: steps of each plan that become labels.
    """
    scenario = flight.scenario
    passed = hoops_passed_along(scenario, states, actions)[:-1]
    through = np.flatnonzero(passed == len(scenario.hoops))
    if not len(through):
        return concatenate([])
    careful = replace(flight, scenario=replace(scenario, tolerance=tightened(scenario.tolerance)))
    plans = replans_along(careful, states[:-1], passed, every, since=int(through[0]))
    return concatenate(
        [
            labels_along(scenario, plan.states[: steps + 1], plan.actions[:steps], plan.step, plan.hoops_passed)
            for plan in plans
        ]
    )


def tightened(tolerance: Tolerance) -> Tolerance:
    """Return the tolerance that plans must meet."""
    return Tolerance(*(PLAN_TOLERANCE * value for value in (tolerance.position, tolerance.speed, tolerance.angle)))


def labels_along(
    scenario: Scenario, states: Array, actions: NDArray[Any], step: int = 0, hoops_passed: int = 0
) -> ExpertData:
    """Return the observations at states (K+1, 5) with the actions (K, 2) as labels.

    Args:
        scenario: the scenario of the observations.
        states: shape (K+1, 5).
        actions: shape (K, 2).
        step: environment steps before the first state.
        hoops_passed: hoops passed before the first state.
    """
    count = len(actions)
    passed = hoops_passed_along(scenario, states, actions, hoops_passed)[:-1]
    steps = np.minimum(step + np.arange(count), scenario.max_steps - 1)
    episodes = EpisodeState(states[:-1], steps, passed, np.zeros(count, dtype=np.int64))
    observations = task.observe(Scene.of([scenario] * count), episodes)
    return ExpertData(observations, np.asarray(actions, dtype=np.float32), labels=count)


def time_reversed(flight: FewestSteps) -> FewestSteps:
    """Return a flight reversed in time, from goal to start: same thrust, tilt and path; velocity and rate negated."""
    scenario = flight.scenario
    hoops = tuple(replace(hoop, angle=hoop.angle - np.copysign(np.pi, hoop.angle)) for hoop in scenario.hoops[::-1])
    turned = replace(scenario, start=scenario.goal, goal=scenario.start, hoops=hoops)
    states = (flight.states - [0, 0, 0, 0, 2 * np.pi * flight.winding])[::-1] * (1, 1, -1, -1, 1)
    actions = flight.actions[::-1] * np.array([1, -1], dtype=np.float32)
    return replace(flight, scenario=turned, states=states, actions=actions, winding=-flight.winding)


def hoops_passed_along(scenario: Scenario, states: Array, actions: NDArray[Any], passed: int = 0) -> Integers:
    """Return the hoops passed at states (K+1, 5) under actions (K, 2), `passed` of them before the first state."""
    return np.append(passed, episode_outcomes(scenario, states, actions, passed).hoops_passed)
