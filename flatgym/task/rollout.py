"""Open-loop flight: a sequence of actions flown from the start, with the outcome of every step.

`fly_actions` steps the task as an environment does. `open_loop_states` and `episode_outcomes` give the same in a few
array operations, without a loop over time; a test holds the two together.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from flatgym.task.scene import FLYING, GOAL, EpisodeState, Scene
from flatgym.task.transition import advance, initial


def fly_actions(scenario: Scenario, actions: NDArray[Any]) -> list[EpisodeState]:
    """Fly actions (K, 2) step by step from the start; return the episode's states, the first and the last included.

    The list is shorter than K + 1 when the episode ends before the last action.
    """
    scene = Scene.of([scenario])
    episode = [replace(initial(scene), state=scenario.start_state[None])]
    for action in actions:
        if episode[-1].outcome[0] != FLYING:
            break
        episode.append(advance(scene, episode[-1], scenario.quadrotor.control(action)[None]))
    return episode


def open_loop_states(scenario: Scenario, actions: NDArray[Any], start: Array | None = None) -> Array:
    """Return the states to which actions (K, 2) lead from a state (5,), shape (K+1, 5); by default from the start."""
    controls = scenario.quadrotor.control(actions)
    return scenario.quadrotor.fly(scenario.start_state if start is None else start, controls, scenario.dt)


def episode_outcomes(scenario: Scenario, states: Array, actions: NDArray[Any], hoops_passed: int = 0) -> EpisodeState:
    """Return the episode's state after each of K steps along states (K+1, 5) under actions (K, 2).

    All steps are judged at once. A step depends on those before it by the number of hoops passed. That number is
    settled after as many rounds as there are hoops, because the first hoop is passed whatever comes later, and so on.
    """
    count = len(actions)
    scene, controls, nothing = Scene.of([scenario] * count), scenario.quadrotor.control(actions), np.zeros(count, int)
    passed, settled = nothing + hoops_passed, False
    while not settled:
        after = advance(scene, EpisodeState(states[:-1], np.arange(count), passed, nothing), controls)
        known = np.maximum.accumulate(np.append(hoops_passed, after.hoops_passed[:-1]))
        passed, settled = known, bool((known == passed).all())
    return after


def replay_to_goal(
    scenario: Scenario, actions: NDArray[Any], start: Array | None = None, hoops_passed: int = 0
) -> Array | None:
    """Return the states (k+1, 5) of the flight of actions (K, 2) until it ends at the goal; None if it ends elsewhere.

    Args:
        scenario: what is flown.
        actions: in [-1, 1], shape (K, 2).
        start: the first state, shape (5,); by default the scenario's.
        hoops_passed: how many hoops are passed already.
    """
    states = open_loop_states(scenario, actions, start)
    outcome = episode_outcomes(scenario, states, actions, hoops_passed).outcome
    ends = np.flatnonzero(outcome != FLYING)
    if not ends.size or outcome[ends[0]] != GOAL:
        return None
    return states[: ends[0] + 2]
