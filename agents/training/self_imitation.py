"""Self-imitation: the actor is also fitted to the fastest flight that training has sampled.

A scenario is deterministic, so the actions of a flight from its start lead to the goal again. PPO samples tens of
thousands of such flights. The fastest is one to three steps faster than the flight of the most probable actions, but
too rare to change them. Between two rollouts the actor is therefore fitted to it by maximum likelihood: self-imitation
learning (Oh, Guo, Singh and Lee, 2018) of a single episode. No optimal flight and no expert takes part.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from flatgym import task
from flatgym.quadrotor import Array, nearest_turn
from flatgym.scenarios.scenario import Scenario
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import Scene

RARE = 0.3
"""Share of the arriving flights up to which the best one is imitated: with 0.05, `hoop` ends a step later."""


class Flight:
    """A flight to the goal of a scenario, as training data.

    Args:
        scenario: the scenario, from whose start the flight begins.
        actions: in [-1, 1], shape (K, 2).
        excess: see `FlightRecorder`.
    """

    def __init__(self, scenario: Scenario, actions: torch.Tensor, excess: float) -> None:
        self.scenario, self.actions, self.excess = scenario, actions, excess

    @property
    def rank(self) -> tuple[int, float]:
        """Steps, then excess: less is better."""
        return len(self.actions), self.excess

    @cached_property
    def observations(self) -> torch.Tensor:
        """The observations before each action, shape (K, 19)."""
        scene, flown = Scene.of([self.scenario]), fly_actions(self.scenario, self.actions.numpy())[:-1]
        return torch.from_numpy(np.concatenate([task.observe(scene, episode) for episode in flown]))

    def fit(self, model: PPO, steps: int) -> None:
        """Raise the probability of the actions by gradient steps, with the model's own optimizer."""
        policy = model.policy
        for _ in range(steps):
            loss = -policy.get_distribution(self.observations).log_prob(self.actions).mean()
            policy.optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(policy.parameters(), model.max_grad_norm)
            policy.optimizer.step()


class FlightRecorder:
    """Finds the best flight from a scenario's start to the goal among the episodes of a training.

    Flights of equal steps are ranked by their excess: how far their last state but one is from the goal, in
    tolerances. A flight whose excess is below 1 would have arrived a step earlier, so it falls as flights improve.

    Args:
        scenario: the scenario.
        states: states of the vehicles after a reset, shape (n, 5).
        best: the best flight so far, if there is one.
    """

    def __init__(self, scenario: Scenario, states: Array, best: Flight | None = None) -> None:
        self.scenario, self.best = scenario, best
        self._actions = np.zeros((scenario.max_steps, len(states), 2), dtype=np.float32)
        self._steps, self._before = np.zeros(len(states), dtype=np.int64), states.copy()
        self._counted = self._at_start(states)
        self._arrivals = self._as_fast = 0

    def imitate(self, model: PPO, steps: int) -> None:
        """Fit a model to the best flight by so many gradient steps, if flights as fast were rare since the last call.

        A flight that is no longer rare needs no imitation, which would end the exploration around it.
        """
        if self.best is not None and self._as_fast <= RARE * self._arrivals:
            self.best.fit(model, steps)
        self._arrivals = self._as_fast = 0

    def step(
        self, actions: NDArray[np.float32], states: Array, dones: NDArray[np.bool_], infos: Sequence[dict[str, Any]]
    ) -> None:
        """Record a step.

        Args:
            actions: actions of the vehicles, shape (n, 2).
            states: their states after the step, or after the reset that followed, shape (n, 5).
            dones: whether an episode ended, shape (n,).
            infos: of the step, one for each vehicle.
        """
        self._actions[self._steps, np.arange(len(actions))] = actions
        self._steps += 1
        for i in np.flatnonzero(dones & self._counted).tolist():
            if not infos[i]["is_success"]:
                continue
            rank = int(self._steps[i]), excess(self.scenario, self._before[i])
            self._arrivals += 1
            self._as_fast += self.best is not None and rank[0] <= len(self.best.actions)
            if self.best is None or rank < self.best.rank:
                self.best = Flight(self.scenario, torch.from_numpy(self._actions[: rank[0], i].copy()), rank[1])
        self._steps[dones], self._counted[dones] = 0, self._at_start(states[dones])
        self._before = states.copy()

    def _at_start(self, states: Array) -> NDArray[np.bool_]:
        return (states == self.scenario.start_state).all(axis=1)


def excess(scenario: Scenario, state: Array) -> float:
    """Return how far a state (5,) is from the goal in position, speed or angle, in tolerances: the largest of them."""
    off, tolerance = state - scenario.goal_state, scenario.tolerance
    angle = abs(nearest_turn(off[4]))
    distance, speed = np.hypot(off[0], off[1]), np.hypot(off[2], off[3])
    return float(max(distance / tolerance.position, speed / tolerance.speed, angle / tolerance.angle))
