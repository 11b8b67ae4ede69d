"""Validation during training: deterministic episodes, the learning curve, and the best policy so far.

    validation = Validation("hoop", target=70)
    improved = validation.run(policy, env_steps=0, wall_time=0.0)

Policies are ranked by success rate first and by steps second. Validation episodes share no seed with training or with
scores. On a named scenario one episode suffices, because it is deterministic.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.evaluation.rollouts import Episodes, fly
from agents.policies.policy import Policy
from flatgym.quadrotor import Array
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import ProblemLike
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.scenarios.scenario import Scenario
from flatgym.task.scene import EpisodeState, Scene
from flatgym.task.shaping import remaining_path_length

VALIDATION_SEED = EVALUATION_SEED - 100_000
"""Seed of the first validation episode: above all training seeds and below those of scores."""
Point = dict[str, Any]
"""A point of a learning curve: env_steps, wall_time_s, outcome, success_rate, steps, hoops_passed, way_left."""


def validation_scenarios(problem: ProblemLike, episodes: int, seed: int = VALIDATION_SEED) -> list[Scenario]:
    """Return the scenarios of the validation episodes: one for a scenario, which is deterministic."""
    chosen = catalogue.problem(problem)
    return [chosen] if isinstance(chosen, Scenario) else [chosen.scenario(seed + i) for i in range(episodes)]


class Validation:
    """Rolls out a policy when asked and appends a point to its learning curve.

    Args:
        problem: a scenario or a distribution.
        seed: seed of the first episode.
        episodes: episodes on a distribution.
        target: steps at which the policy needs no improvement; no target by default.
        curve: the curve to extend, for a resumed training.

    Attributes:
        curve: the points so far.
    """

    def __init__(
        self,
        problem: ProblemLike,
        seed: int = VALIDATION_SEED,
        episodes: int = 64,
        target: float = -np.inf,
        curve: list[Point] | None = None,
    ) -> None:
        self.problem, self.seed, self.target = catalogue.problem(problem), seed, target
        self._scene = Scene.of(validation_scenarios(self.problem, episodes, seed))
        self.episodes = len(self._scene)
        self.curve: list[Point] = [] if curve is None else curve

    @property
    def target_reached(self) -> bool:
        """Whether a policy succeeded in every episode within the target steps."""
        return any(point["success_rate"] == 1 and point["steps"] <= self.target for point in self.curve)

    def run(self, policy: Policy, env_steps: int, wall_time: float) -> bool:
        """Roll out the policy, append a point to the curve, and return whether it ranks above all earlier points.

        Args:
            policy: the policy in training.
            env_steps: environment steps of the training so far.
            wall_time: wall time of the training so far [s].
        """
        flights = fly(policy, self.problem, self.episodes, self.seed)
        point = {"env_steps": env_steps, "wall_time_s": round(wall_time, 1)} | statistics(flights, self._scene)
        improved = all(rank(point) > rank(other) for other in self.curve)
        self.curve.append(point)
        return improved


def rank(point: Point) -> tuple[float, float]:
    """Return the rank of a point, greater is better: success rate first, then fewer steps."""
    return point["success_rate"], -point["steps"]


def milestones(curve: Sequence[Point], success: float) -> list[Point]:
    """Return the points of a learning curve that statistics need: each that is better than all before, and the last.

    A point is better by its rank, or by fewer steps at a success rate of at least `success`.
    """
    kept, best, least = [], (-np.inf, -np.inf), np.inf
    for point in curve:
        steps = point["steps"] if point["success_rate"] >= success else np.inf
        if rank(point) > best or steps < least or point is curve[-1]:
            kept.append(point)
        best, least = max(best, rank(point)), min(least, steps)
    return kept


def best_of(curve: Sequence[Point]) -> Point | None:
    """Return the first point of the highest rank, or None if no episode of any point succeeded."""
    best = max(curve, key=rank, default=None)
    return best if best and best["success_rate"] > 0 else None


def statistics(flights: Episodes, scene: Scene) -> Point:
    """Return the most frequent outcome, the success rate, and the mean steps of the successes (of all if none).

    Before the first success, two values tell how near the flights come: the mean number of hoops passed, and the mean
    of the least length of the way through the hoops ahead to the goal [m], which is 0 for a success.

    Args:
        flights: n episodes without disturbances.
        scene: their scenarios.
    """
    succeeded = np.array([word == "goal" for word in flights.outcomes])
    steps = float(flights.steps[succeeded].mean() if succeeded.any() else flights.steps.mean())
    left = np.where(succeeded, 0.0, least_ways(flights, scene))
    return {
        "outcome": Counter(flights.outcomes).most_common(1)[0][0],
        "success_rate": float(succeeded.mean()),
        "steps": int(steps) if steps.is_integer() else steps,
        "hoops_passed": float(flights.hoops_passed.mean()),
        "way_left": round(float(np.mean(left)), 3),
    }


def least_ways(flights: Episodes, scene: Scene) -> Array:
    """Return the least length of the way through the hoops ahead to the goal during each flight [m], shape (n,)."""
    counts = flights.steps + 1
    states, passed = np.concatenate(flights.states), np.concatenate(flights.passed)
    nothing = np.zeros_like(passed)
    ways = remaining_path_length(scene.repeat(counts), EpisodeState(states, nothing, passed, nothing))
    return np.minimum.reduceat(ways, np.cumsum(counts) - counts)
