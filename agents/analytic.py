"""Analytic policy gradients: a policy learns by differentiating through the exact step of the flight itself.

The step is a closed form, so what a flight's end owes to each weight of the network is known exactly, and no reward
needs to be explored (as in Xu et al. 2022 for simulators that are smooth). The learner flies beside the flights of
an expert, in n scenarios at once, and its cost is how far it is from where they are,

    sum over k of w_k |(x_k - x*_k) / tolerance|^2,

with a weight of 1 at the goal and where hoops are passed, and a small one on the way. An action is clipped to
[-1, 1]; its derivative beyond is kept where it leads back inside, and is zero where it leads further out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from agents.advice import SCATTER
from agents.configs import Count, NonNegative, Positive
from agents.experts import tolerances
from agents.imitation import CloneConfig, Keeper
from agents.networks import act, actor_parameters
from flatgym.quadrotor import exact_step
from flatgym.scene import Scene
from flatgym.task import FAR, HOOPS_SEEN, LENGTH_UNIT, SPEED_UNIT
from optimal.steps import FewestSteps

Tensor = torch.Tensor
ON_THE_WAY = 0.02
"""Weight of a step on the way."""


CLIPPED = 1.0
"""Largest norm of a gradient."""


@dataclass(frozen=True)
class AnalyticConfig(CloneConfig):
    """Everything it depends on, besides the flights."""

    learning_rate: Positive = 1e-4
    """Learning rate at the beginning, falling to zero along a cosine; ten times as much loses what was learnt."""
    batch: Count = 16
    """Flights of an update."""
    updates: Count = 600
    """Gradient steps."""
    scatter: NonNegative = 0.03
    """How far the starts of three flights in four are scattered, as a factor on SCATTER."""
    check_every: Count = 20
    """Updates between two checks."""
    seconds: Positive = 600.0
    """Wall time, of the keeper's clock, after which it ends [s]."""


class Clip(torch.autograd.Function):
    """Clips to [-1, 1]; see the module for its derivative."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:
        ctx.save_for_backward(value)
        return value.clamp(-1, 1)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> Tensor:
        (value,) = ctx.saved_tensors
        return torch.where((value.abs() > 1) & (value * slope < 0), 0.0, slope)


@dataclass(frozen=True)
class Course:
    """n flights to follow, as tensors; T is the longest one's number of steps, H the most hoops.

    Attributes:
        goal: shape (n, 2) [m].
        hoops: centre, direction, diameter of each hoop, shape (n, H + HOOPS_SEEN, 5), zero where there is none.
        hoop_count: shape (n,).
        floor, ceiling: heights [m], shape (n,).
        time_limit: in steps, shape (n,).
        states: where the expert is after each step, at the goal when it has arrived, shape (n, T+1, 5).
        weights: of each step, zero after the expert's last one, shape (n, T+1).
    """

    goal: Tensor
    hoops: Tensor
    hoop_count: Tensor
    floor: Tensor
    ceiling: Tensor
    time_limit: Tensor
    states: Tensor
    weights: Tensor

    @classmethod
    def of(cls, flights: Sequence[FewestSteps]) -> Course:
        """Return the flights of n scenarios as tensors."""
        scene = Scene.of([flight.scenario for flight in flights])
        n, most, longest = len(flights), scene.hoop_centre.shape[1], max(len(flight.actions) for flight in flights)
        hoops = np.zeros((n, most + HOOPS_SEEN, 5))
        there = np.arange(most) < scene.hoop_count[:, None]
        packed = np.concatenate([scene.hoop_centre, scene.hoop_direction, scene.hoop_diameter[..., None]], axis=-1)
        hoops[:, :most] = np.where(there[..., None], packed, 0.0)
        states, weights = np.zeros((n, longest + 1, 5)), np.zeros((n, longest + 1))
        for i, flight in enumerate(flights):
            steps, goal = len(flight.actions), flight.scenario.goal_state
            goal[4] = 2 * np.pi * flight.winding
            states[i, :steps], states[i, steps:] = flight.states[:-1], goal
            weights[i, :steps], weights[i, steps] = ON_THE_WAY, 1.0
            weights[i, 0] = 0.0
            for hoop in flight.scenario.hoops:
                along = (flight.states[:, :2] - hoop.centre) @ hoop.direction
                for k in np.flatnonzero((along[:-1] < 0) & (along[1:] >= 0)):
                    weights[i, k : k + 2] = 1.0
        values = (scene.goal, hoops, scene.hoop_count, scene.floor, scene.ceiling, scene.max_steps, states, weights)
        return cls(*(torch.as_tensor(value, dtype=torch.float32) for value in values))

    def rows(self, which: Tensor) -> Course:
        """Return the flights `which`, shape (m,)."""
        return Course(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def observe(course: Course, state: Tensor, passed: Tensor, step: int) -> Tensor:
    """Return what n vehicles see in states (n, 5) after `step` steps with `passed` hoops behind them, shape (n, 19)."""
    place, theta = state[:, 0:2], state[:, 4:5]
    columns = [squash(course.goal - place), squash(state[:, 2:4], SPEED_UNIT), torch.sin(theta), torch.cos(theta)]
    for i in range(HOOPS_SEEN):
        hoop = course.hoops[torch.arange(len(state)), passed + i]
        there = hoop[:, 4:5] > 0
        columns += [torch.where(there, squash(hoop[:, 0:2] - place), 0.0), hoop[:, 2:4], squash(hoop[:, 4:5])]
    heights = torch.stack([state[:, 1] - course.floor, course.ceiling - state[:, 1]], dim=-1)
    time = (step / course.time_limit)[:, None].clamp(max=1.0)
    return torch.cat([*columns, squash(heights.clamp(max=FAR)), time], dim=-1)


def squash(length: Tensor, unit: float = LENGTH_UNIT) -> Tensor:
    """Return length / (unit + |length|)."""
    return length / (unit + length.abs())


def deviation(model: PPO, course: Course, scene: Scene, start: Tensor) -> Tensor:
    """Fly from states (n, 5) beside the course; return each flight's cost, shape (n,), differentiable.

    Args:
        model: whose actor flies.
        course: n flights to follow.
        scene: whose vehicle, step and tolerance they share.
        start: where the learner starts, shape (n, 5).
    """
    quadrotor, scale = scene.quadrotor, torch.as_tensor(tolerances(scene.tolerance), dtype=torch.float32)
    low, high = (
        torch.as_tensor(limit, dtype=torch.float32) for limit in (quadrotor.control_low, quadrotor.control_high)
    )
    state, cost = start, torch.zeros(len(start))
    passed, rows = torch.zeros(len(start), dtype=torch.int64), torch.arange(len(start))
    for k in range(course.states.shape[1] - 1):
        action: Tensor = Clip.apply(act(model, observe(course, state, passed, k)))  # type: ignore[no-untyped-call]
        control = low + (high - low) * (action + 1) / 2
        flown = exact_step(state.unbind(-1), control.unbind(-1), scene.dt, quadrotor.gravity, torch)
        before, state, hoop = state, torch.stack(flown, dim=-1), course.hoops[rows, passed]
        sides = [((place[:, 0:2] - hoop[:, 0:2]) * hoop[:, 2:4]).sum(-1) for place in (before, state)]
        passed = passed + ((hoop[:, 4] > 0) & (sides[0] < 0) & (sides[1] >= 0)).long()
        off = (state - course.states[:, k + 1]) / scale
        cost = cost + course.weights[:, k + 1] * off.square().sum(-1)
    return cost


def follow(model: PPO, flights: Sequence[FewestSteps], config: AnalyticConfig, keeper: Keeper) -> PPO:
    """Let a model that flies nearly like the experts learn to fly beside them; return it as it flew best.

    Args:
        model: as cloning or DAgger left it; a beginner's flights end too far away to tell anything.
        flights: the experts' flights, of the scenario or of many that a distribution draws.
        config: updates, learning rate and size of a batch.
        keeper: checks it now and then; the last update is made when time is up, or nothing can be improved.
    """
    generator = np.random.default_rng(config.seed)
    parameters = actor_parameters(model)
    optimizer = torch.optim.Adam(parameters, lr=config.learning_rate)
    fall = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.updates)
    scene = Scene.of([flights[0].scenario])
    course = Course.of(flights)
    starts = np.array([flight.states[0] for flight in flights])
    for update in range(1, config.updates + 1):
        which = generator.integers(len(flights), size=config.batch)
        scattered = starts[which] + config.scatter * SCATTER * generator.normal(size=(config.batch, 5))
        scattered[: config.batch // 4] = starts[which[: config.batch // 4]]
        start = torch.as_tensor(scattered, dtype=torch.float32)
        # The logarithm weighs a flight by how much it can still be improved, not by how far it went astray.
        cost = torch.log1p(deviation(model, course.rows(torch.from_numpy(which)), scene, start)).mean()
        optimizer.zero_grad()
        cost.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(parameters, CLIPPED)
        optimizer.step()
        fall.step()
        keeper.env_steps += int((course.weights[which] > 0).sum())
        if update % config.check_every == 0:
            keeper.check(model)
            if keeper.satisfied or keeper.elapsed > config.seconds:
                break
    return keeper.restore(model)
