"""Open-loop rollouts: states and outcomes of a sequence of actions.

`fly_actions` steps the task as an environment does. `open_loop_states` and `episode_outcomes` give the same in a few
array operations, without a loop over time. A test holds the two together.
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
    """Return the episode states under actions (K, 2) from the scenario's start, the first and the last included.

    The list has K + 1 entries, fewer if the episode ends before the last action.
    """
    scene = Scene.of([scenario])
    episode = [replace(initial(scene), state=scenario.start_state[None])]
    for action in actions:
        if episode[-1].outcome[0] != FLYING:
            break
        episode.append(advance(scene, episode[-1], scenario.quadrotor.control(action)[None]))
    return episode


def open_loop_states(scenario: Scenario, actions: NDArray[Any], start: Array | None = None) -> Array:
    """Return the states under actions (K, 2), shape (K+1, 5), from a state (5,), by default the scenario's start."""
    controls = scenario.quadrotor.control(actions)
    return scenario.quadrotor.fly(scenario.start_state if start is None else start, controls, scenario.dt)


def episode_outcomes(scenario: Scenario, states: Array, actions: NDArray[Any], hoops_passed: int = 0) -> EpisodeState:
    """Return the episode state after each of K steps along states (K+1, 5) under actions (K, 2).

    All steps are evaluated at once. A step depends on earlier ones only through the number of hoops passed, which a
    fixed-point iteration finds. Each round settles at least the next hoop, so it ends after one round for each hoop and
    one more.

    Entries after the first outcome other than "flying" have no meaning for the environment, which has ended there.
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
    """Return the states (k+1, 5) until the episode ends at the goal after k steps; None if it does not end there.

    Args:
        scenario: the scenario.
        actions: in [-1, 1], shape (K, 2).
        start: the first state, shape (5,); by default the scenario's.
        hoops_passed: number of hoops passed before the first step.
    """
    states = open_loop_states(scenario, actions, start)
    outcome = episode_outcomes(scenario, states, actions, hoops_passed).outcome
    ends = np.flatnonzero(outcome != FLYING)
    if not ends.size or outcome[ends[0]] != GOAL:
        return None
    return states[: ends[0] + 2]
