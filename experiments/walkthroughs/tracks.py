"""What an environment's actions fly, as a track to draw: the one helper that the walk-throughs share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.figures import Track
from flatgym import OUTCOMES
from flatgym.scenario import Scenario
from flatgym.task import fly_actions


def flown(who: str, scenario: Scenario, actions: NDArray[np.float32]) -> Track:
    """Return the flight of a scenario by actions (K, 2), its name saying who flew, how many steps and to what end."""
    situations = fly_actions(scenario, actions)
    states = np.array([situation.state[0] for situation in situations])
    # Controls are one fewer than states; a track holds the last one on.
    controls = scenario.quadrotor.control(np.append(actions, actions[-1:], axis=0))[: len(states)]
    name = f"{who}, {len(states) - 1} steps: {OUTCOMES[situations[-1].outcome[0]]}"
    return Track(name, np.linspace(0.0, scenario.dt * (len(states) - 1), len(states)), states, controls)
