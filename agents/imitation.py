"""Imitation: a network learns what an expert does, from recorded flights and from its own.

    clone(recorded(minari.load_dataset("flatquad/hoop/optimal-v0"), "hoop"), CloneConfig(scenario="hoop"))
    dagger(student(config), adviser, config, Keeper(config))    # advisers: `agents.advice`

Behaviour cloning fits the actions of recorded flights (Pomerleau 1989). What it learns about is where the expert
went; a small error leads elsewhere, where nobody showed what to do. DAgger (Ross, Gordon and Bagnell 2011) therefore
flies the learner, asks the expert what it would have done from where the learner came to, adds that to what there is,
and fits again. The policy that flies best of all rounds is kept.

A time-optimal flight has its controls mostly at a limit, and the network's output is clipped. So where the expert's
action is at a limit, whatever lies beyond counts as equal to it: nothing is spent on how far beyond.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import minari
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents.configs import Checked, Count, Natural, Positive, PPOConfig
from agents.evaluate import fly
from agents.networks import act, actor_parameters
from agents.recording import check
from agents.schedules import Point, outcome_of, rank
from agents.train import build
from flatgym import catalogue
from flatgym.scenario import Scenario
from flatgym.task import OBSERVATION_NAMES


@dataclass(frozen=True)
class CloneConfig(Checked):
    """Everything a cloning depends on, besides what is shown."""

    seed: Natural = 0
    """Seed of network and batches."""
    width: Count = 96
    """Units of each hidden layer of the actor."""
    depth: Count = 3
    """Hidden layers."""
    zoom: Positive = 8.0
    """Factor on all observations but the attitude, before the network: bang-bang controls switch within centimetres."""
    guidance: bool = False
    """Whether the network sees what guidance laws steer by as well, and not the time; see `agents.guidance`."""
    learning_rate: Positive = 2e-3
    """Learning rate at the beginning, falling along a cosine."""
    batch: Count = 512
    """Size of a minibatch."""
    updates: Count = 4000
    """Gradient steps."""
    check_seed: Natural = 500_000
    """Seed of the flights by which policies are ranked; on a distribution neither those trained on nor those scored."""
    check_episodes: Count = 64
    """Their number on a distribution; on a scenario one tells all."""


@dataclass(frozen=True)
class DaggerConfig(CloneConfig):
    """Everything DAgger depends on, besides the adviser."""

    updates: Count = 1000
    """Gradient steps of each round."""
    rounds: Count = 8
    """Rounds of flying, asking and fitting."""
    seconds: Positive = 600.0
    """Wall time after which no further round begins [s]."""


class Shown(NamedTuple):
    """What was shown.

    Attributes:
        observations: float32, shape (n, 19).
        actions: what to do there, float32, shape (n, 2).
        flown: environment steps that a learner flew for it.
        asked: steps for which an expert said what to do; there may be more rows, as of mirror images.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    flown: int = 0
    asked: int = 0


Adviser = Callable[[PPO | None, int], Shown]
"""Flies a learner, or the expert itself where there is none yet, in a round, and returns what the expert would do."""


def recorded(dataset: minari.MinariDataset, problem: str) -> Shown:
    """Return what a dataset of demonstrations of a scenario or distribution shows.

    Raises:
        ValueError: for a dataset of another environment or scenario, naming both.
    """
    check(dataset, problem)
    episodes = list(dataset.iterate_episodes())
    return Shown(
        np.concatenate([episode.observations[:-1] for episode in episodes]),
        np.concatenate([episode.actions for episode in episodes]),
        asked=int(dataset.total_steps),
    )


def joined(parts: Sequence[Shown]) -> Shown:
    """Return all that was shown as one."""
    nothing = Shown(np.zeros((0, len(OBSERVATION_NAMES)), np.float32), np.zeros((0, 2), np.float32))
    observations, actions, flown, asked = zip(nothing, *parts, strict=True)
    return Shown(np.concatenate(observations), np.concatenate(actions), sum(flown), sum(asked))


def mirrored(shown: Shown) -> Shown:
    """Return what was shown and its mirror image at x = 0, of which physics knows no difference."""
    signs = [-1 if name.endswith(("_x", "sin_theta")) else 1 for name in OBSERVATION_NAMES]
    turned = np.array([1, -1], dtype=np.float32)
    reflected = Shown(shown.observations * np.array(signs, dtype=np.float32), shown.actions * turned)
    return joined([shown, reflected])


def loss(output: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """Return the squared error, shape (n, 2), zero where output and action are beyond the same limit."""
    error = output - action
    beyond = (action.abs() >= 1) & (error * action.sign() > 0)
    return torch.where(beyond, torch.zeros_like(error), error.square())


def student(config: CloneConfig) -> PPO:
    """Return an untrained PPO whose actor is to learn; its critic is for whoever goes on with PPO."""
    return build(
        PPOConfig(
            scenario=config.scenario,
            seed=config.seed,
            width=config.width,
            depth=config.depth,
            value_width=64,
            zoom=config.zoom,
            guidance=config.guidance,
            num_envs=1,
            batch=64,
        )
    )


def fit(model: PPO, shown: Shown, config: CloneConfig, share: float = 1.0) -> float:
    """Fit the actor to what was shown; return the mean loss of the last tenth of the updates.

    Args:
        model: is changed.
        shown: n observations and actions.
        config: batch, updates and learning rate.
        share: of the learning rate to begin with; a fifth of it is left at the end.
    """
    optimizer = torch.optim.Adam(actor_parameters(model), lr=config.learning_rate * share)
    fall = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.updates, config.learning_rate * share / 5)
    observations, actions = torch.from_numpy(shown.observations), torch.from_numpy(shown.actions)
    recent: list[float] = []
    for rows in batches(len(observations), config):
        error = loss(act(model, observations[rows]), actions[rows]).mean()
        optimizer.zero_grad()
        error.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        fall.step()
        recent.append(error.item())
    return float(np.mean(recent[-max(1, config.updates // 10) :]))


def batches(count: int, config: CloneConfig) -> Iterator[torch.Tensor]:
    """Yield the rows of `config.updates` minibatches of `count` rows, pass after pass in a new order."""
    left = torch.zeros(0, dtype=torch.int64)
    for _ in range(config.updates):
        while len(left) < min(config.batch, count):
            left = torch.cat([left, torch.randperm(count)])
        rows, left = left[: config.batch], left[config.batch :]
        yield rows


def clone(shown: Shown, config: CloneConfig) -> PPO:
    """Return a PPO whose actor imitates what was shown (behaviour cloning); `agents.policies.save` keeps it."""
    model = student(config)
    fit(model, shown, config)
    return model


class Keeper:
    """Checks a policy now and then, extends its learning curve, and remembers the best.

    Args:
        config: what is flown to check.
        target: success in so few steps is the best there is.
        watch: is told each point.
    """

    def __init__(
        self, config: CloneConfig, target: float = 0.0, watch: Callable[[Point], Any] = lambda _: None
    ) -> None:
        self.config, self.target, self.watch, self.began = config, target, watch, time.perf_counter()
        self.episodes = 1 if isinstance(catalogue.problem(config.scenario), Scenario) else config.check_episodes
        self.curve: list[Point] = []
        self.best: dict[str, torch.Tensor] = {}
        self.env_steps = 0

    @property
    def elapsed(self) -> float:
        """Wall time since the keeper was made [s]."""
        return time.perf_counter() - self.began

    @property
    def satisfied(self) -> bool:
        """Whether the best policy needs no improvement."""
        return any(point["success_rate"] == 1 and point["steps"] <= self.target for point in self.curve)

    def check(self, model: PPO) -> Point:
        """Fly the policy deterministically, and return the new point of the curve."""
        flights = fly(model, self.config.scenario, self.episodes, self.config.check_seed)
        point = {"env_steps": self.env_steps, "wall_time_s": round(self.elapsed, 1), **outcome_of(flights)}
        if all(rank(point) > rank(other) for other in self.curve):
            self.best = {name: value.clone() for name, value in model.policy.state_dict().items()}
        self.curve.append(point)
        self.watch(point)
        return point

    def restore(self, model: PPO) -> PPO:
        """Give the model the weights of the best check."""
        model.policy.load_state_dict(self.best)
        return model


def dagger(model: PPO, adviser: Adviser, config: DaggerConfig, keeper: Keeper) -> PPO:
    """Let a model fly, be advised, and learn, round by round; return it as it flew best (DAgger).

    Args:
        model: a `student`, or one that has learnt something.
        adviser: flies it, and says what the expert would have done.
        config: rounds, time and gradient steps.
        keeper: checks it after each round; the last ends when time is up, or nothing can be improved.
    """
    shown = [adviser(None, 0)]
    for number in range(1, config.rounds + 1):
        fit(model, joined(shown), config, share=1 - (number - 1) / config.rounds)
        keeper.check(model)
        if keeper.satisfied or keeper.elapsed > config.seconds or number == config.rounds:
            break
        shown.append(adviser(model, number))
        keeper.env_steps += shown[-1].flown
    return keeper.restore(model)
