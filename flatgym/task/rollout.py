"""TODO flatgym/task/rollout.py."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from flatgym.scenarios.scenario import Scenario
from flatgym.task.scene import (
    FLYING,
    Scene,
    Situation,
)
from flatgym.task.transition import advance, initial


def fly_actions(scenario: Scenario, actions: NDArray[Any]) -> list[Situation]:
    """Fly actions (K, 2) from the scenario's start; return the situations, from the start to the end of the flight.

    The list is shorter than K + 1 when the flight ends before the last action.
    """
    scene = Scene.of([scenario])
    situations = [replace(initial(scene), state=scenario.start_state[None])]
    for action in actions:
        if situations[-1].outcome[0] != FLYING:
            break
        situations.append(advance(scene, situations[-1], scenario.quadrotor.control(action)[None]))
    return situations
